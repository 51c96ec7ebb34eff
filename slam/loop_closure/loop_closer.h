// Loop closure (seed 1, section 4.9): which markers close a loop, and the map after its correction.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "base/task.h"
#include "slam/loop_closure/pose_graph.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

struct LoopOptions {
  // A frame joins both ends of a loop as they are when more than this share of the loop's markers
  // agree with its pose. Larger corrects more often where there is little to correct, smaller joins
  // ends that do not belong together.
  double min_joining_share = 0.5;
  // Frames that see both ends of a loop after a closure was rejected until the next is begun: the
  // same evidence gives the same answer, at the cost of a whole closure.
  int frames_between_attempts = 10;
  // Markers that must fit a frame's pose for the only one that closes a loop, rejected for that, to
  // be held to disagree: as TrackerOptions::min_witnesses.
  int min_witnesses = 2;
  // Beside the spanning tree of section 4.9.2, each keyframe keeps its strongest connections in the
  // pose graph, so that loops closed before stay closed.
  int edges_per_keyframe = 4;
  PoseGraphOptions pose_graph;
  BundleOptions optimization{.max_iterations = 15, .min_relative_decrease = 1e-4};
  // A closure is rejected when it raises the cost of what the map saw before by more than this
  // much, in units of the noise: a constant, and a share of that cost; times the number of markers
  // that close it. A true closure takes back drift, which the old views hardly resist; a false one
  // bends them. One marker alone may have moved; several that agree with each other hardly have.
  double max_growth = 60.0;
  double max_growth_share = 0.01;
  // Beyond that, by this share of the cost that the corners' own noise does not explain. It comes
  // from the lens model and from bent paper; such errors go together, and a true closure has to pay
  // for those of the whole way round.
  double max_growth_of_model_errors = 0.2;
  // Largest mean squared whitened error of the closing frame's corners (2 residuals each), in units
  // of the noise.
  double max_closing_error = 12.0;
  // Of two candidates (one ambiguous marker closes the loop) the better one must be this much
  // better.
  double ambiguity_ratio = 3.0;
  // They are two only if the closing frame ends up turned by this much, radians: the optimization
  // may lead the second one to the first one's map, which is no contradiction.
  double other_rotation_rad = 0.05;
  // Added to both growths before they are compared, in units of the noise: odds, not a quotient of
  // small numbers. What noise alone makes of one view.
  double ambiguity_floor = 8.0;
  // A closure gets as much of a frame as it needs to be done after so many, before what is not
  // corrected meanwhile has gone far astray: units for each view of a marker, all iterations
  // together. More than Options::work_per_frame only in large maps ...
  double cost_per_view = 16.0;
  double frames_to_close = 60.0;
  // ... and never more than this: in the largest a closure takes longer.
  double max_cost_per_frame = 750.0;
  // In a map of more keyframes than this so many around the frame are optimized together, where
  // markers of the neighbourhood have come to disagree, or the ends of a loop differ by little.
  // More take out strain of a larger part, and longer to do it.
  int region_keyframes = 600;
  // There a marker that fewer keyframes have seen closes no loop, as long as it is near where it
  // should be: it is known too little to disagree. More begin fewer closures for nothing.
  int sure_views = 3;
  // After a closure that has seen to a part of the map the whole of it is optimized once so many
  // frames in a row have left time: 0.2 s at 150 Hz. Fewer begin it while the map still grows.
  int frames_before_relaxing = 30;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// The frame that sees both ends of a loop.
struct LoopFrame {
  Keyframe frame;                   // T_w_c as tracked: gamma^t
  std::vector<int> loop_markers;    // L(t) of Eq. 35, those of them that agree with each other
  std::vector<Transform> expected;  // gamma-dot^t: one pose, or the two of an ambiguous marker
  KeyframeId reference = -1;        // f^omega
};

struct ClosedLoop {
  MapCorrection correction;  // of the map as it was when the closing began
  KeyframeId newest = -1;    // of the map then
  Keyframe closing;          // the closing frame, where it belongs
  Transform T_w_tracked;     // and where it was tracked
};

// The whole map at its optimum, where closures have only seen to parts of it.
struct RelaxedMap {
  MapCorrection correction;  // of the map as it was when that began
  KeyframeId newest = -1;    // of the map then
};

enum class LoopRejection {
  kNoEvidence,    // the loop's markers do not say where the frame is
  kContradicted,  // the corrected map does not fit what was seen
  kAmbiguous,     // both candidates fit about equally well
};

// Finds the correction of the map: pose graph (Eq. 37-39), markers (Eq. 40), optimization; and
// tests it. The world stays where it is. The map may go on growing meanwhile. What is given by
// reference must outlive the task.
using LoopOutcome = std::variant<ClosedLoop, RelaxedMap, LoopRejection>;
Task<LoopOutcome> closeLoop(const Map& map, LoopFrame loop, const MarkerOptions& markers,
                            LoopOptions options, Budget* budget);

// The same where markers of the neighbourhood, L(t), have come to disagree: there is no loop, but
// the map is bent between its last views and older ones. Optimizes a part of it, from where it is:
// the keyframes around the reference and around the last that saw those markers.
Task<LoopOutcome> relaxRegion(const Map& map, LoopFrame loop, const MarkerOptions& markers,
                              LoopOptions options, Budget* budget);

// No loop at all: the whole map, from where it is.
Task<LoopOutcome> relaxMap(const Map& map, const MarkerOptions& markers, LoopOptions options,
                           Budget* budget);

// Eq. 40 for every marker: it moves as the cameras that see it, named by marker, moved from
// `before` to `after`.
Task<Done> correctMarkers(const std::vector<std::vector<int>>& by_marker,
                          const std::vector<BundleProblem::Pose>& before,
                          const std::vector<Transform>& after,
                          std::vector<BundleProblem::Pose>* markers, Budget* budget);

// The spanning tree of section 4.9.2 (Kruskal, the strongest connections first) and each camera's
// strongest edges, as the problem's poses have them.
Task<PoseGraph> covisibilityGraph(const BundleProblem& problem, int edges_per_keyframe,
                                  Budget* budget);

}  // namespace waymark::slam
