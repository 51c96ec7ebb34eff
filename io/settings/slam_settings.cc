#include "io/settings/slam_settings.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <iterator>
#include <string_view>
#include <utility>

#include "io/settings/marker_ids.h"
#include "io/settings/pose_settings.h"
#include "io/text/closest_word.h"
#include "io/text/plausible.h"
#include "io/text/text_file.h"
#include "slam/detection/codes/dictionary.h"

namespace waymark::io {
namespace {

constexpr int kLargestId = 1'000'000;

// One [[slam.markers.anchors]].
std::vector<Setting> anchorKeys(slam::Anchor& anchor) {
  return {required(integerSetting("id", anchor.id, 0, kLargestId)),
          required(positionSetting("p_m", anchor.T_w_m)),
          required(orientationSetting("q_wxyz", anchor.T_w_m)),
          numberSetting("sigma_m", anchor.sigma_m, 1e-6, 100.0, "m"),
          numberSetting("sigma_rad", anchor.sigma_rad, 1e-6, 10.0, "rad")};
}

// Three numbers that are a position, or, where they need not be, any three.
Setting vectorSetting(std::string key, bool is_position,
                      std::function<void(const Eigen::Vector3d&)> take) {
  return numbersSetting(
      std::move(key), 3,
      [is_position, take = std::move(take)](std::span<const double> v) -> ValidationError {
        const Eigen::Vector3d vector(v[0], v[1], v[2]);
        if (is_position && !isPosition(vector)) return kPositions;
        take(vector);
        return {};
      });
}

// "3, 7-9" into `take`.
Setting idsSetting(std::string key,
                   std::function<ValidationError(std::vector<slam::IdRange>)> take) {
  return checkedTextSetting(std::move(key),
                            [take = std::move(take)](const std::string& text) -> ValidationError {
                              const auto ranges = parseIdRanges(text);
                              if (!ranges) return ranges.error().message;
                              return take(*ranges);
                            });
}

// One [[slam.markers.sizes]].
std::vector<Setting> sizeKeys(slam::MarkerOptions::Size& size) {
  const auto take = [&size](const std::vector<slam::IdRange>& ids) -> ValidationError {
    if (ids.size() != 1) return "must be one id or one range of ids like \"7-9\"";
    size.ids = ids.front();
    return {};
  };
  return {required(idsSetting("ids", take)),
          required(numberSetting("size_m", size.size_m, 1e-3, 100.0, "m"))};
}

Setting idsSetting(std::string key, std::vector<slam::IdRange>& target) {
  return idsSetting(std::move(key), [&target](std::vector<slam::IdRange> ids) -> ValidationError {
    target = std::move(ids);
    return {};
  });
}

// One [[slam.markers.positions]].
std::vector<Setting> positionKeys(slam::SurveyedPosition& position) {
  const auto take = [&position](const Eigen::Vector3d& p_w) { position.p_w = p_w; };
  return {required(integerSetting("id", position.id, 0, kLargestId)),
          required(vectorSetting("p_m", /*is_position=*/true, take)),
          numberSetting("sigma_m", position.sigma_m, 1e-6, 100.0, "m")};
}

// One [[slam.markers.planes]].
std::vector<Setting> planeKeys(slam::MarkerPlane& plane) {
  using slam::PlaneKind;
  return {textSetting("name", plane.name), required(idsSetting("ids", plane.ids)),
          choiceSetting<PlaneKind>("kind", plane.kind,
                                   {{"any", PlaneKind::kAny},
                                    {"floor", PlaneKind::kFloor},
                                    {"ceiling", PlaneKind::kCeiling},
                                    {"wall", PlaneKind::kWall}}),
          numberSetting("sigma_m", plane.sigma_m, 1e-6, 100.0, "m"),
          numberSetting("sigma_rad", plane.sigma_rad, 1e-6, 10.0, "rad")};
}

// One [[slam.markers.distances]].
std::vector<Setting> distanceKeys(slam::CornerDistance& distance) {
  return {required(integerSetting("id_a", distance.id_a, 0, kLargestId)),
          required(integerSetting("corner_a", distance.corner_a, 0, 3)),
          required(integerSetting("id_b", distance.id_b, 0, kLargestId)),
          required(integerSetting("corner_b", distance.corner_b, 0, 3)),
          required(numberSetting("distance_m", distance.distance_m, 1e-3, 1e6, "m")),
          numberSetting("sigma_m", distance.sigma_m, 1e-6, 100.0, "m")};
}

std::vector<Setting> constraintKeys(slam::MarkerConstraints& known) {
  const auto take_up = [&known](const Eigen::Vector3d& up_w) { known.up_w = up_w; };
  return {
      sectionsSetting<slam::SurveyedPosition>("slam.markers.positions", known.positions,
                                              positionKeys),
      sectionsSetting<slam::MarkerPlane>("slam.markers.planes", known.planes, planeKeys),
      idsSetting("slam.markers.upright.ids", known.upright.ids),
      numberSetting("slam.markers.upright.sigma_rad", known.upright.sigma_rad, 1e-6, 10.0, "rad"),
      sectionsSetting<slam::CornerDistance>("slam.markers.distances", known.distances,
                                            distanceKeys),
      vectorSetting("slam.markers.up", /*is_position=*/false, take_up),
      numberSetting("slam.markers.gate_sigmas", known.gate_sigmas, 1.0, 1e6, ""),
  };
}

std::vector<Setting> markerKeys(slam::MarkerOptions& markers) {
  const auto ignore = [&markers](std::vector<slam::IdRange> ids) -> ValidationError {
    markers.ignored = std::move(ids);
    return {};
  };
  return {
      idsSetting("slam.markers.ignored", ignore),
      integerSetting("slam.markers.origin", markers.origin_marker, 0, kLargestId),
      sectionsSetting<slam::MarkerOptions::Size>("slam.markers.sizes", markers.other_sizes,
                                                 sizeKeys),
      sectionsSetting<slam::Anchor>("slam.markers.anchors", markers.anchors, anchorKeys),
  };
}

std::vector<Setting> detectionKeys(slam::Options& o) {
  slam::DetectorOptions& detector = o.detector;
  return {
      numberSetting("slam.detector.scanner.quads.min_side_px", detector.scanner.quads.min_side_px,
                    4.0, 1000.0, "px"),
      numberSetting("slam.detector.edges.fit.min_contrast", detector.edges.fit.min_contrast, 1.0,
                    255.0, "grey levels"),
      integerSetting("slam.detector.decoder.max_wrong_bits", detector.decoder.max_wrong_bits, 0, 8),
      numberSetting("slam.detector.decoder.min_likeness", detector.decoder.min_likeness, 0.0, 1.0,
                    ""),
      flagSetting("slam.follower.enabled", o.follower.enabled),
      numberSetting("slam.follower.schedule.round_s", o.follower.schedule.round_s, 0.01, 10.0, "s"),
  };
}

std::vector<Setting> trackingKeys(slam::TrackerOptions& tracking) {
  return {
      numberSetting("slam.tracking.pose.marker_chi2", tracking.pose.marker_chi2, 1.0, 1e6, ""),
      numberSetting("slam.tracking.pose.max_rms_px", tracking.pose.max_rms_px, 0.1, 100.0, "px"),
      numberSetting("slam.tracking.motion.max_extrapolation_s", tracking.motion.max_extrapolation_s,
                    0.0, 10.0, "s"),
      numberSetting("slam.tracking.relocalization.ambiguity_ratio",
                    tracking.relocalization.ambiguity_ratio, 1.0, 1000.0, ""),
  };
}

std::vector<Setting> mapperKeys(slam::MapperOptions& mapper) {
  slam::KeyframeOptions& keyframes = mapper.keyframes;
  return {
      numberSetting("slam.mapper.keyframes.min_baseline_m", keyframes.min_baseline_m, 1e-4, 100.0,
                    "m"),
      numberSetting("slam.mapper.keyframes.min_baseline_per_depth",
                    keyframes.min_baseline_per_depth, 0.0, 10.0, ""),
      numberSetting("slam.mapper.keyframes.min_rotation_rad", keyframes.min_rotation_rad, 1e-3, 3.0,
                    "rad"),
      integerSetting("slam.mapper.keyframes.views_per_marker", keyframes.views_per_marker, 2, 1000),
      integerSetting("slam.mapper.marker_pose.min_views", mapper.marker_pose.min_views, 2, 100),
      numberSetting("slam.mapper.marker_pose.ambiguity_ratio", mapper.marker_pose.ambiguity_ratio,
                    1.0, 1000.0, ""),
      integerSetting("slam.mapper.local_optimization.max_iterations",
                     mapper.local_optimization.max_iterations, 1, 100),
  };
}

// Keys that files written before had in another place, and where they are now.
constexpr std::array<std::pair<std::string_view, std::string_view>, 16> kRenamed = {{
    {"slam.detector.scanner.min_side_px", "slam.detector.scanner.quads.min_side_px"},
    {"slam.follower.turns.round_s", "slam.follower.schedule.round_s"},
    {"slam.initialisation.ambiguity_ratio", "slam.initialization.ambiguity_ratio"},
    {"slam.tracking.marker_chi2", "slam.tracking.pose.marker_chi2"},
    {"slam.tracking.worst_rms_px", "slam.tracking.pose.max_rms_px"},
    {"slam.motion.max_extrapolation_s", "slam.tracking.motion.max_extrapolation_s"},
    {"slam.relocalisation.ambiguity_ratio", "slam.tracking.relocalization.ambiguity_ratio"},
    {"slam.relocalization.ambiguity_ratio", "slam.tracking.relocalization.ambiguity_ratio"},
    {"slam.keyframes.min_baseline_m", "slam.mapper.keyframes.min_baseline_m"},
    {"slam.keyframes.min_baseline_per_depth", "slam.mapper.keyframes.min_baseline_per_depth"},
    {"slam.keyframes.min_rotation_rad", "slam.mapper.keyframes.min_rotation_rad"},
    {"slam.keyframes.views_per_marker", "slam.mapper.keyframes.views_per_marker"},
    {"slam.marker_pose.min_views", "slam.mapper.marker_pose.min_views"},
    {"slam.marker_pose.ambiguity_ratio", "slam.mapper.marker_pose.ambiguity_ratio"},
    {"slam.local_optimisation.max_iterations", "slam.mapper.local_optimization.max_iterations"},
    {"slam.local_optimization.max_iterations", "slam.mapper.local_optimization.max_iterations"},
}};

// The daemon's other sections.
constexpr std::array<std::string_view, 10> kOtherSections = {
    "body",    "camera", "control",  "log",    "natural",
    "publish", "queue",  "realtime", "record", "relocalizer"};

// A family's name without what programs write differently: "tag36h11", "DICT_APRILTAG_36h11" and
// "36h11" are one.
std::string plainFamily(std::string_view name) {
  std::string plain;
  for (const char c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) continue;
    plain += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  for (const std::string_view prefix : {"dict", "april", "tag"}) {
    if (plain.starts_with(prefix)) plain.erase(0, prefix.size());
  }
  return plain;
}

std::string meantDictionary(const std::string& name, const std::vector<std::string>& known) {
  const std::string plain = plainFamily(name);
  for (const std::string& other : known) {
    if (plain == plainFamily(other)) return "; did you mean " + other + "?";
  }
  return didYouMean(name, known);
}

}  // namespace

ValidationError validateDictionary(const std::string& name) {
  const std::vector<std::string> names = slam::Dictionary::names();
  std::string known;
  for (const std::string& other : names) {
    if (other == name) return {};
    known += " " + other;
  }
  return "\"" + name + "\" is not a known dictionary" + meantDictionary(name, names) +
         "; known are" + known;
}

std::string foreignMarkersReason(const SlamSettings& settings) {
  const auto dictionary = slam::Dictionary::byName(settings.dictionary);
  if (!dictionary) return {};
  const std::string not_in = " is not in " + settings.dictionary + ", whose ids are 0 to " +
                             std::to_string(dictionary->size() - 1);
  const auto foreign = [&](const std::string& what, int id) {
    return what + " " + std::to_string(id) + not_in;
  };
  const slam::MarkerOptions& markers = settings.options.markers;
  if (markers.origin_marker && *markers.origin_marker >= dictionary->size()) {
    return foreign("the origin marker", *markers.origin_marker);
  }
  for (const slam::Anchor& anchor : markers.anchors) {
    if (anchor.id >= dictionary->size()) return foreign("anchor", anchor.id);
  }
  const std::string constrained =
      markers.constraints.findId([&](int id) { return id >= dictionary->size(); });
  if (constrained.empty()) return {};
  return constrained + not_in;
}

std::vector<Setting> slamSettingKeys(SlamSettings& target) {
  slam::Options& o = target.options;
  std::vector<Setting> keys = {
      required(textSetting("slam.dictionary", target.dictionary, validateDictionary)),
      required(numberSetting("slam.marker_size_m", o.markers.size_m, 1e-3, 100.0, "m")),
      pathSetting("slam.map_in", target.map.in),
      pathSetting("slam.map_out", target.map.out),
      flagSetting("slam.localize_only", target.map.localize_only),
      integerSetting("slam.map_save_interval_s", target.map.save_interval_s, 0, 1'000'000),
      numberSetting("slam.work_per_frame", o.work_per_frame, 10.0, 1e6, ""),
      numberSetting("slam.initialization.ambiguity_ratio", o.initialization.ambiguity_ratio, 1.0,
                    1000.0, ""),
      flagSetting("slam.pieces.begin", o.pieces.begin),
      integerSetting("slam.pieces.max_pieces", o.pieces.max_pieces, 1, 10'000),
      flagSetting("slam.covariance.enabled", o.covariance.enabled),
      numberSetting("slam.covariance.cost_per_frame", o.covariance.cost_per_frame, 1.0, 1e6, ""),
      flagSetting("slam.natural.enabled", o.natural.enabled),
      integerSetting("slam.natural.integrator.max_markers", o.natural.integrator.max_markers, 1,
                     1000),
      integerSetting("slam.natural.filter.filter.max_features",
                     o.natural.filter.filter.max_features, 10, 200),
      numberSetting("slam.natural.integrator.max_prediction_s",
                    o.natural.integrator.max_prediction_s, 0.0, 1.0, "s"),
      numberSetting("slam.natural.integrator.max_error_m", o.natural.integrator.max_error_m, 0.01,
                    100.0, "m"),
      numberSetting("slam.natural.integrator.max_error_rad", o.natural.integrator.max_error_rad,
                    0.01, 3.0, "rad"),
      numberSetting("slam.natural.integrator.start.border", o.natural.integrator.start.border, 0.0,
                    0.45, ""),
      numberSetting("slam.natural.integrator.start.min_area", o.natural.integrator.start.min_area,
                    0.0, 0.99, ""),
      numberSetting("slam.natural.integrator.start.max_area", o.natural.integrator.start.max_area,
                    0.01, 1.0, ""),
      flagSetting("camera.learn", o.lens.learn),
      numberSetting("camera.fov_deg", target.fov_deg, 10.0, 175.0, "degrees"),
      numberSetting("slam.shutter.readout_s", o.shutter.readout_s, -0.2, 0.2, "s"),
  };
  std::ranges::move(detectionKeys(o), std::back_inserter(keys));
  std::ranges::move(trackingKeys(o.tracking), std::back_inserter(keys));
  std::ranges::move(mapperKeys(o.mapper), std::back_inserter(keys));
  std::ranges::move(markerKeys(o.markers), std::back_inserter(keys));
  std::ranges::move(constraintKeys(o.markers.constraints), std::back_inserter(keys));
  for (const auto& [old_key, key] : kRenamed) {
    keys.push_back(renamedSetting(std::string(old_key), std::string(key)));
  }
  return keys;
}

Result<SlamSettings> readSlamSettings(const std::filesystem::path& file) {
  const Result<std::string> text = readTextFile(file);
  if (!text) return text.error();
  return parseSlamSettings(*text, file);
}

Result<SlamSettings> parseSlamSettings(const std::string& text, const std::filesystem::path& file) {
  SlamSettings result;
  std::vector<Setting> keys = slamSettingKeys(result);
  for (Setting& key : keys) key.required = false;
  if (const Status read = readSettings(text, file, keys, kOtherSections); !read) {
    return read.error();
  }
  return result;
}

}  // namespace waymark::io
