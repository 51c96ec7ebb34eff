// Events since the start, each by cause; health and stats.json read them.
#pragma once

#include <array>
#include <cstdint>

namespace waymark::slam {

// What each counts stands in kCounters.
struct Counters {
  std::uint64_t frames = 0;
  std::uint64_t localized = 0;
  std::uint64_t keyframes_added = 0;
  std::uint64_t relocalizations = 0;
  std::uint64_t loop_closures = 0;
  std::uint64_t rejected_markers = 0;
  std::uint64_t rejected_poses = 0;
  std::uint64_t loops_without_drift = 0;
  std::uint64_t loops_refused = 0;
  std::uint64_t clipped_markers = 0;
  std::uint64_t doubled_markers = 0;
  std::uint64_t flipped_markers = 0;
  std::uint64_t quarantined_markers = 0;
  std::uint64_t gated_views = 0;
  std::uint64_t gated_constraints = 0;
  std::uint64_t refused_markers = 0;
  std::uint64_t bridged_frames = 0;
  std::uint64_t linked_markers = 0;
  std::uint64_t linked_gaps = 0;
  std::uint64_t linked_nearer = 0;
  std::uint64_t mapped_pictures = 0;
  std::uint64_t picture_poses = 0;
  std::uint64_t refused_pictures = 0;
  std::uint64_t late_unknown = 0;
  std::uint64_t photographs_by_picture = 0;
  std::uint64_t predicted_frames = 0;
  std::uint64_t uncertain_frames = 0;
  std::uint64_t wary_frames = 0;
  std::uint64_t filter_restarts = 0;
  std::uint64_t starts_outside = 0;
  std::uint64_t full_scans = 0;
  std::uint64_t followed_frames = 0;
  std::uint64_t frames_in_other_world = 0;
  std::uint64_t pieces_begun = 0;
  std::uint64_t pieces_joined = 0;
  std::uint64_t pieces_parted = 0;
  std::uint64_t pieces_undecided = 0;
  std::uint64_t other_prints = 0;
  std::uint64_t quads = 0;
  std::uint64_t merged_quads = 0;
  std::uint64_t rejected_quads = 0;
  std::uint64_t quads_without_edges = 0;
  std::uint64_t quads_without_code = 0;
  std::uint64_t quads_unlike_code = 0;
  std::uint64_t busy_frames = 0;
  std::uint64_t deferred_candidates = 0;
  std::uint64_t image_cells_seen = 0;
};

struct NamedCounter {
  const char* name;  // in stats.json, and after "slam." in health messages
  std::uint64_t Counters::*value;
  const char* counts;  // as docs/health.md says it
};

// Every counter, in the order in which health messages and stats.json list them.
inline constexpr std::array kCounters = {
    NamedCounter{"frames", &Counters::frames, "frames processed"},
    NamedCounter{"localized", &Counters::localized, "of these, with a pose"},
    NamedCounter{"keyframes_added", &Counters::keyframes_added, "keyframes added to the map"},
    NamedCounter{"relocalizations", &Counters::relocalizations,
                 "times the camera was lost and found again"},
    NamedCounter{"loop_closures", &Counters::loop_closures,
                 "loops closed with a correction of the map"},
    NamedCounter{"rejected_markers", &Counters::rejected_markers,
                 "markers left out of a pose because they did not fit"},
    NamedCounter{"rejected_poses", &Counters::rejected_poses,
                 "poses that were computed and rejected"},
    NamedCounter{"loops_without_drift", &Counters::loops_without_drift,
                 "loops whose ends agreed, and were joined as they were"},
    NamedCounter{"loops_refused", &Counters::loops_refused,
                 "loops that were tested and contradicted the map"},
    NamedCounter{"clipped_markers", &Counters::clipped_markers,
                 "markers with a corner at the image's border or beyond"},
    NamedCounter{"doubled_markers", &Counters::doubled_markers,
                 "an id twice in one frame: both left out"},
    NamedCounter{"flipped_markers", &Counters::flipped_markers,
                 "markers whose second pose turned out to be the right one"},
    NamedCounter{"quarantined_markers", &Counters::quarantined_markers,
                 "markers that moved or contradicted the map; they get a pose anew"},
    NamedCounter{"gated_views", &Counters::gated_views,
                 "views too far off for a local optimization"},
    NamedCounter{
        "gated_constraints", &Counters::gated_constraints,
        "what was said of markers (planes, distances, ...) and their views contradict, in a "
        "local optimization"},
    NamedCounter{"refused_markers", &Counters::refused_markers,
                 "markers printed twice, or moved again and again"},
    NamedCounter{"bridged_frames", &Counters::bridged_frames,
                 "frames whose pose is from natural features, as no marker gave one"},
    NamedCounter{"linked_markers", &Counters::linked_markers,
                 "markers that joined the map through a gap, by natural features"},
    NamedCounter{"linked_gaps", &Counters::linked_gaps,
                 "gaps that ended at markers of the map, and tie them to those before"},
    NamedCounter{"linked_nearer", &Counters::linked_nearer,
                 "nearer views of such new markers that tell how they are turned"},
    NamedCounter{"mapped_pictures", &Counters::mapped_pictures,
                 "natural markers that got a place in the map"},
    NamedCounter{"picture_poses", &Counters::picture_poses,
                 "poses of earlier frames, from pictures found in them, that the filter took"},
    NamedCounter{"refused_pictures", &Counters::refused_pictures,
                 "such poses that contradicted the filter"},
    NamedCounter{"late_unknown", &Counters::late_unknown,
                 "pictures told of frames that nobody remembers any more"},
    NamedCounter{"photographs_by_picture", &Counters::photographs_by_picture,
                 "photographs whose pose is from a picture found in them, as no marker gave one"},
    NamedCounter{"predicted_frames", &Counters::predicted_frames,
                 "frames whose pose is from the motion alone"},
    NamedCounter{"uncertain_frames", &Counters::uncertain_frames,
                 "frames whose carried pose was less certain than its limit, and is none"},
    NamedCounter{"wary_frames", &Counters::wary_frames,
                 "frames in which features were distrusted, as things moved in view"},
    NamedCounter{"filter_restarts", &Counters::filter_restarts,
                 "times the filter of natural features contradicted the markers, and began anew"},
    NamedCounter{"starts_outside", &Counters::starts_outside,
                 "frames and pictures that features did not begin at, for where in the image the "
                 "marker or picture is"},
    NamedCounter{"full_scans", &Counters::full_scans, "frames searched as a whole"},
    NamedCounter{"followed_frames", &Counters::followed_frames,
                 "frames searched where markers were expected, and in turns"},
    NamedCounter{
        "frames_in_other_world", &Counters::frames_in_other_world,
        "frames in which what is to fix the world, the origin marker or any anchor, had no "
        "place in the map yet"},
    NamedCounter{"pieces_begun", &Counters::pieces_begun,
                 "pieces of the map begun because the camera was lost among unknown markers"},
    NamedCounter{"pieces_joined", &Counters::pieces_joined,
                 "pieces that became part of an older one"},
    NamedCounter{"pieces_parted", &Counters::pieces_parted,
                 "joints of pieces that later views refuted, and that were undone"},
    NamedCounter{"pieces_undecided", &Counters::pieces_undecided,
                 "times that frames with markers of two pieces did not tell yet how these lie to "
                 "each other"},
    NamedCounter{
        "other_prints", &Counters::other_prints,
        "markers left out as another print of their id, with nothing around them that hangs "
        "around the one of the map"},
    NamedCounter{"quads", &Counters::quads, "dark squares found where markers were searched for"},
    NamedCounter{"merged_quads", &Counters::merged_quads,
                 "of these, another outline of a marker that was found already"},
    NamedCounter{"rejected_quads", &Counters::rejected_quads,
                 "of these, not looked at, as they were no marker a few frames ago"},
    NamedCounter{"quads_without_edges", &Counters::quads_without_edges,
                 "squares, and markers followed, without a clean edge at each side"},
    NamedCounter{"quads_without_code", &Counters::quads_without_code,
                 "squares, and markers followed, without a border or a code of the dictionary"},
    NamedCounter{"quads_unlike_code", &Counters::quads_unlike_code,
                 "squares that read as a code, and do not look like its print"},
    NamedCounter{"busy_frames", &Counters::busy_frames,
                 "frames too busy to be searched as a whole; searched in turns"},
    NamedCounter{"deferred_candidates", &Counters::deferred_candidates,
                 "dark regions that may be markers, left for later frames"},
    NamedCounter{"image_cells_seen", &Counters::image_cells_seen,
                 "cells of the image, of 80, in which a marker's corner has been"},
};
static_assert(sizeof(Counters) == kCounters.size() * sizeof(std::uint64_t), "one is missing here");

[[nodiscard]] inline Counters operator+(Counters a, const Counters& b) {
  for (const NamedCounter& counter : kCounters) a.*counter.value += b.*counter.value;
  return a;
}

}  // namespace waymark::slam
