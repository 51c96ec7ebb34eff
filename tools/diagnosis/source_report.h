// What is found of a source of images, a line for each thing that a run depends on.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/camera/lens_knowledge.h"
#include "tools/diagnosis/family_survey.h"
#include "tools/diagnosis/image_quality.h"

namespace waymark::diagnosis {

struct Finding {
  enum class Level { kGood, kNote, kBad };
  Level level = Level::kGood;
  std::string what;  // one word
  std::string text;
};

// How evenly frames come. times_ns: one after the other. nominal_hz: what the source promises; 0:
// nothing.
[[nodiscard]] Finding timesFinding(std::span<const std::int64_t> times_ns, double nominal_hz);

// Light and focus, one each.
[[nodiscard]] std::vector<Finding> qualityFindings(const ImageQuality& quality);

// Which families there are. `asked`: the one that somebody expects; empty: none.
[[nodiscard]] std::vector<Finding> familyFindings(std::span<const FamilyCount> families,
                                                  const OddImages& odd, std::size_t images,
                                                  const std::string& asked);

// How far markers move in the image from one frame to the next, pixels.
[[nodiscard]] Finding motionFinding(std::vector<double> steps_px);

// While a lens is being learned.
inline constexpr const char* kWhatTeachesALens =
    "come nearer to markers, tilt the camera, bring them to the edges of the image";

// What markers say of a lens. `file`: who says which lens it is; empty: nobody, and `known.given`
// is a guess. `focal_px`: of the lens in use, pixels.
[[nodiscard]] Finding lensFinding(const std::string& file, const slam::LensKnowledge& known,
                                  double focal_px);
// That the lens that was given is the one that the markers show, only better known by now.
[[nodiscard]] std::string refinedText(const slam::LensKnowledge& known, double focal_px);
// That another lens was learned than the one that was given.
[[nodiscard]] std::string misfitText(const slam::LensKnowledge& known, double focal_px);

// "good   focus      the sharpest edges are ..."
[[nodiscard]] std::string formatFinding(const Finding& finding);

}  // namespace waymark::diagnosis
