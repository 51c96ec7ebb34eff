#include "tools/diagnosis/family_survey.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>

#include "base/quantile.h"
#include "slam/detection/marker_detector.h"

namespace waymark::diagnosis {
namespace {

double sidePx(const slam::MarkerDetection& marker) {
  double round_px = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    round_px += (marker.pixels[(i + 1) % 4] - marker.pixels[i]).norm();
  }
  return 0.25 * round_px;
}

// How likely the cells of any dark square are one of the family's codes.
double chanceOf(const slam::Dictionary& dictionary) {
  return 4.0 * dictionary.size() / std::pow(2.0, dictionary.side() * dictionary.side());
}

// "4X4_" of "4X4_50"; empty of a family that is alone.
std::string_view kinOf(std::string_view name) {
  const bool sized = name.size() > 4 && name[1] == 'X' && name[3] == '_';
  return sized ? name.substr(0, 4) : std::string_view();
}

// Three markers are needed to say that a family is there; where codes come up by chance, they come
// up with other ids each time.
bool isCredible(const FamilyCount& found, const slam::Dictionary& dictionary) {
  constexpr int kLeast = 3;
  constexpr double kUnlikely = 1e-4;
  if (found.markers < kLeast) return false;
  if (chanceOf(dictionary) < kUnlikely) return true;
  return 2 * std::ssize(found.ids) <= found.markers;
}

void leaveSmallestOfKin(std::vector<FamilyCount>* found) {
  std::vector<FamilyCount> kept;
  for (const FamilyCount& family : *found) {
    const std::string_view kin = kinOf(family.dictionary);
    const bool has_kin = !kin.empty() && std::ranges::any_of(kept, [&](const FamilyCount& other) {
      return kinOf(other.dictionary) == kin;
    });
    if (!has_kin) kept.push_back(family);
  }
  *found = std::move(kept);
}

}  // namespace

std::string idList(const std::set<int>& ids) {
  constexpr std::size_t kMost = 6;
  std::string text;
  std::size_t listed = 0;
  for (const int id : ids) {
    if (listed == kMost) return text + " and " + std::to_string(ids.size() - kMost) + " more";
    text += (listed++ == 0 ? "" : ", ") + std::to_string(id);
  }
  return text;
}

slam::CameraModel guessedCamera(int width, int height) {
  constexpr double kFocalPerWidth = 0.87;  // 60 degrees
  const double focal = kFocalPerWidth * std::max(width, height);
  return slam::CameraModel({.width = width,
                            .height = height,
                            .fx = focal,
                            .fy = focal,
                            .cx = 0.5 * (width - 1),
                            .cy = 0.5 * (height - 1)});
}

FamilyCount countFamily(const std::string& dictionary, std::span<const GreyImage> images,
                        const slam::CameraModel& camera) {
  FamilyCount found{.dictionary = dictionary};
  slam::DetectorOptions options;
  options.rejected_frames = 0;  // one image has nothing to do with the one before
  slam::MarkerDetector detector(camera, *slam::Dictionary::byName(dictionary), options);
  std::vector<double> sides;
  for (const GreyImage& image : images) {
    if (image.width != camera.width() || image.height != camera.height()) continue;
    const int before = found.markers;
    for (const slam::MarkerDetection& marker : detector.detect(image.view())) {
      if (marker.hamming > 0) continue;
      ++found.markers;
      found.ids.insert(marker.id);
      sides.push_back(sidePx(marker));
    }
    if (found.markers > before) ++found.images;
  }
  if (!sides.empty()) {
    std::ranges::sort(sides);
    found.median_side_px = quantile(std::span<const double>(sides), 500);
  }
  return found;
}

std::vector<FamilyCount> surveyFamilies(std::span<const GreyImage> images,
                                        const slam::CameraModel& camera) {
  std::vector<FamilyCount> found;
  for (const std::string& name : slam::Dictionary::names()) {
    FamilyCount family = countFamily(name, images, camera);
    if (isCredible(family, *slam::Dictionary::byName(name))) found.push_back(std::move(family));
  }
  // The smaller family of two with as many: it has them all.
  std::ranges::stable_sort(found, [](const FamilyCount& a, const FamilyCount& b) {
    if (a.markers != b.markers) return a.markers > b.markers;
    return slam::Dictionary::byName(a.dictionary)->size() <
           slam::Dictionary::byName(b.dictionary)->size();
  });
  leaveSmallestOfKin(&found);
  return found;
}

OddImages lookForOddImages(std::span<const GreyImage> images, const slam::CameraModel& camera) {
  std::vector<GreyImage> mirror;
  std::vector<GreyImage> negative;
  for (const GreyImage& image : images) {
    mirror.push_back(mirrored(image.view()));
    negative.push_back(inverted(image.view()));
  }
  const auto first = [&](const std::vector<GreyImage>& changed) -> std::optional<FamilyCount> {
    std::vector<FamilyCount> found = surveyFamilies(changed, camera);
    if (found.empty()) return std::nullopt;
    return std::move(found.front());
  };
  return {first(mirror), first(negative)};
}

}  // namespace waymark::diagnosis
