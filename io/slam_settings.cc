#include "io/slam_settings.h"

#include <array>
#include <string_view>

#include "io/text_file.h"
#include "slam/detection/dictionary.h"

namespace waymark::io {
namespace {

// The daemon's other sections.
constexpr std::array<std::string_view, 4> kOtherSections = {"camera", "queue", "publish", "log"};

}  // namespace

Objection objectToDictionary(const std::string& name) {
  if (slam::Dictionary::byName(name)) return {};
  std::string known;
  for (const std::string& other : slam::Dictionary::names()) known += " " + other;
  return "\"" + name + "\" is not a known dictionary; known are" + known;
}

std::vector<Setting> slamSettingKeys(SlamSettings& target) {
  slam::Options& o = target.options;
  auto& scanner = o.detector.scanner;
  return {
      required(textSetting("slam.dictionary", target.dictionary, objectToDictionary)),
      required(numberSetting("slam.marker_size_m", o.markers.size_m, 1e-3, 100.0, "m")),
      integerSetting("slam.detector.scanner.threshold_window_px", scanner.threshold_window_px, 3,
                     255),
      numberSetting("slam.detector.scanner.min_side_px", scanner.min_side_px, 4.0, 1000.0, "px"),
      numberSetting("slam.detector.edges.fit.min_contrast", o.detector.edges.fit.min_contrast, 1.0,
                    255.0, "grey levels"),
      integerSetting("slam.detector.decoder.max_wrong_bits", o.detector.decoder.max_wrong_bits, 0,
                     8),
      numberSetting("slam.initialisation.ambiguity_ratio", o.initialisation.ambiguity_ratio, 1.0,
                    1000.0, ""),
      numberSetting("slam.tracking.marker_chi2", o.tracking.pose.marker_chi2, 1.0, 1e6, ""),
      numberSetting("slam.tracking.worst_rms_px", o.tracking.pose.worst_rms_px, 0.1, 100.0, "px"),
      numberSetting("slam.motion.max_extrapolation_s", o.tracking.motion.max_extrapolation_s, 0.0,
                    10.0, "s"),
      numberSetting("slam.keyframes.min_baseline_m", o.mapper.keyframes.min_baseline_m, 1e-4, 100.0,
                    "m"),
      numberSetting("slam.keyframes.min_baseline_per_depth",
                    o.mapper.keyframes.min_baseline_per_depth, 0.0, 10.0, ""),
      numberSetting("slam.keyframes.min_rotation_rad", o.mapper.keyframes.min_rotation_rad, 1e-3,
                    3.0, "rad"),
      integerSetting("slam.keyframes.views_per_marker", o.mapper.keyframes.views_per_marker, 2,
                     1000),
      integerSetting("slam.marker_pose.min_views", o.mapper.marker_pose.min_views, 2, 100),
      numberSetting("slam.marker_pose.ambiguity_ratio", o.mapper.marker_pose.ambiguity_ratio, 1.0,
                    1000.0, ""),
      numberSetting("slam.relocalisation.ambiguity_ratio",
                    o.tracking.relocalisation.ambiguity_ratio, 1.0, 1000.0, ""),
      integerSetting("slam.local_optimisation.max_iterations",
                     o.mapper.local_optimisation.max_iterations, 1, 100),
  };
}

Result<SlamSettings> readSlamSettings(const std::filesystem::path& file) {
  const Result<std::string> text = readTextFile(file);
  if (!text) return text.error();
  SlamSettings result;
  std::vector<Setting> keys = slamSettingKeys(result);
  for (Setting& key : keys) key.required = false;
  if (const Status read = readSettings(*text, file, keys, kOtherSections); !read) {
    return read.error();
  }
  return result;
}

}  // namespace waymark::io
