// What a run came to, in words, and what would help where it came to little. All of it from what
// was measured.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/diagnosis/family_survey.h"
#include "tools/diagnosis/image_quality.h"

namespace waymark::diagnosis {

// What a handful of the images, spread over the run, show.
struct ImageFacts {
  std::size_t images = 0;
  ImageQuality quality;
  std::vector<FamilyCount> families;  // the likeliest first
  FamilyCount own;                    // of the family that was asked for
  OddImages odd;                      // empty where a family was found
};

struct RunFacts {
  std::string dictionary;  // asked for
  double marker_size_m = 0.0;
  double focal_px = 0.0;
  std::size_t frames = 0;
  std::size_t localized = 0;
  std::size_t frames_with_markers = 0;
  std::size_t markers_seen = 0;  // in all frames
  std::map<int, std::size_t> seen_by_id{};
  double median_side_px = 0.0;  // of them; 0: none
  std::size_t rejected_markers = 0;
  double rms_px = 0.0;  // of the poses; 0: none
  // False: the corners were found by somebody else, perhaps less well.
  bool own_corners = true;
  bool lens_given = true;  // by a calibration; else it is learned
  // Standard deviation of the focal length as a share of it, while the lens is not learned; else 0.
  double lens_open_share = 0.0;
  std::uint64_t quads = 0;
  std::map<std::string, std::size_t> reasons{};  // why frames had no pose
  std::optional<ImageFacts> images{};            // empty: nobody looked, or there are none
};

// Whether it is worth looking at the images: something went wrong, or little was found.
[[nodiscard]] bool wantsImages(const RunFacts& facts);
[[nodiscard]] ImageFacts lookAt(std::span<const GreyImage> images, const std::string& dictionary,
                                const slam::CameraModel& camera);

struct VerdictLimits {
  // Fewer poses than this share of the frames are little.
  double few_poses = 0.5;
  // Poses fit to a tenth of a pixel with the right lens; with a wrong one they cannot.
  double large_rms_px = 0.8;
  double large_rms_of_others_px = 2.4;  // where somebody else found the corners
  // A family is there, and not the one asked for, where it has so many times its markers.
  double other_family_ratio = 5.0;
  double large_marker_m = 2.0;  // a side
  double far_marker_m = 100.0;  // away
  double small_side_px = 12.0;  // in the image
  double many_rejected = 0.2;   // of the markers seen
};

struct Verdict {
  enum class Grade { kGood, kDoubtful, kNone };
  Grade grade = Grade::kGood;
  std::string text;                 // one line
  std::vector<std::string> advice;  // one line each, the likeliest cause first
};

// kNone: there was no pose, or none that can be believed, as the markers are of another family.
[[nodiscard]] Verdict judge(const RunFacts& facts, const VerdictLimits& limits = {});

[[nodiscard]] const char* gradeName(Verdict::Grade grade);
// As it is printed.
[[nodiscard]] std::string formatVerdict(const Verdict& verdict);

}  // namespace waymark::diagnosis
