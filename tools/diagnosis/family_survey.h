// Which families of markers are in some images, whatever somebody believes to be there.
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "tools/diagnosis/grey_image.h"

namespace waymark::diagnosis {

struct FamilyCount {
  std::string dictionary;
  int markers = 0;  // in all images; codes without a wrong bit only
  int images = 0;   // that have some
  std::set<int> ids{};
  double median_side_px = 0.0;  // of the markers
};

// "3, 7, 12, 20, 21, 22 and 9 more".
[[nodiscard]] std::string idList(const std::set<int>& ids);

// A lens without distortion, 60 degrees across: to find markers it will do.
[[nodiscard]] slam::CameraModel guessedCamera(int width, int height);

// How often each family is found, those that are found at all, the likeliest first. Where the
// codes of one are among those of a larger one (4X4_50, 4X4_100, ...), the smallest that has all
// of them. Families whose codes are as likely as not by chance count only where ids come again.
// Takes some milliseconds for each family and image.
[[nodiscard]] std::vector<FamilyCount> surveyFamilies(std::span<const GreyImage> images,
                                                      const slam::CameraModel& camera);

// The same of one family.
[[nodiscard]] FamilyCount countFamily(const std::string& dictionary,
                                      std::span<const GreyImage> images,
                                      const slam::CameraModel& camera);

// Where no family is found in the images: whether one is in their mirror images or negatives.
struct OddImages {
  std::optional<FamilyCount> mirrored;
  std::optional<FamilyCount> inverted;
};
[[nodiscard]] OddImages lookForOddImages(std::span<const GreyImage> images,
                                         const slam::CameraModel& camera);

}  // namespace waymark::diagnosis
