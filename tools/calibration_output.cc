#include "tools/calibration_output.h"

#include <cstdint>
#include <cstdio>
#include <numbers>
#include <vector>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/image_view.h"
#include "io/calibrations/calibration_file.h"
#include "io/calibrations/ros_calibration.h"
#include "io/text/number_text.h"
#include "tools/calibration/report_picture.h"

namespace waymark::tools {
namespace {

using calibration::CalibrationReport;
using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180.0 / std::numbers::pi;

std::string modelName(calibration::Lens lens) {
  switch (lens) {
    case calibration::Lens::kPlumbBob:
      return "plumb_bob";
    case calibration::Lens::kRational:
      return "rational";
    case calibration::Lens::kEquidistant:
      break;
  }
  return "equidistant";
}

// A value with as many decimals as its uncertainty has.
std::string parameterLine(const std::string& name, double value, double sigma) {
  char line[80];
  const int decimals = sigma > 0.1 ? 2 : (sigma > 0.001 ? 4 : 6);
  std::snprintf(line, sizeof line, "  %-3s %12.*f +- %.*f\n", name.c_str(), decimals, value,
                decimals, sigma);
  return line;
}

Json parametersJson(const calibration::Solution& solution) {
  Json parameters = Json::object();
  const std::vector<std::string> names = calibration::parameterNames(solution.lens);
  const Eigen::VectorXd values = calibration::parametersOf(solution.camera, solution.lens);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    parameters[names[i]] = {{"value", values[index]}, {"sigma", solution.sigma(index)}};
  }
  return parameters;
}

Json viewsJson(const CalibrationReport& report) {
  Json views = Json::array();
  for (const calibration::ViewReport& view : report.views) {
    views.push_back({{"frame", view.name},
                     {"points", view.points},
                     {"rms_px", view.rms_px},
                     {"tilt_deg", kDegrees * view.tilt_rad},
                     {"distance_m", view.distance_m}});
  }
  return views;
}

Json leftOutJson(const CalibrationReport& report) {
  Json views = Json::array();
  for (const calibration::LeftOutView& view : report.left_out) {
    views.push_back({{"frame", view.name}, {"reason", view.reason}});
  }
  return views;
}

Json regionsJson(const CalibrationReport& report) {
  Json cells = Json::array();
  for (const calibration::RegionReport& region : report.region_reports) {
    cells.push_back({{"points", region.points},
                     {"mean_px", {region.mean.x(), region.mean.y()}},
                     {"rms_px", region.rms_px}});
  }
  return {{"columns", report.regions.columns}, {"rows", report.regions.rows}, {"cells", cells}};
}

std::string pictureOf(const CalibrationRun& run, const CalibrationReport& report) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", calibration::drawReport(report, run.source), png);
  return {png.begin(), png.end()};
}

}  // namespace

std::string calibrationText(const CalibrationRun& run, const CalibrationReport& report) {
  const calibration::Solution& solution = report.solution;
  std::string text =
      modelName(solution.lens) + ", " + sizeText(solution.camera.width, solution.camera.height) +
      ": " + std::to_string(report.points) + " points in " + std::to_string(report.views.size()) +
      " views of " + std::to_string(run.with_board) + " frames with the board\n";
  const std::vector<std::string> names = calibration::parameterNames(solution.lens);
  const Eigen::VectorXd values = calibration::parametersOf(solution.camera, solution.lens);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    text += parameterLine(names[i], values[index], solution.sigma(index));
  }
  text += "rms " + io::fixed(solution.rms_px, 3) + " px, covers " +
          io::fixed(100.0 * report.coverage.share(), 0) + " % of the picture\n";
  text += "a point is predicted to " + io::fixed(report.mean_projection_sigma_px, 3) +
          " px in the mean, " + io::fixed(report.max_projection_sigma_px, 3) + " px at (" +
          io::fixed(report.worst_projection_at.x(), 0) + ", " +
          io::fixed(report.worst_projection_at.y(), 0) + ")\n";
  if (report.left_out_points > 0) {
    text += std::to_string(report.left_out_points) + " single corners left out\n";
  }
  for (const calibration::LeftOutView& view : report.left_out) {
    text += "left out: " + view.name + ": " + view.reason + "\n";
  }
  return text;
}

std::string calibrationJson(const CalibrationRun& run, const CalibrationReport& report) {
  const calibration::Solution& solution = report.solution;
  Json json;
  json["format"] = "waymark-calibration";
  json["version"] = 1;
  json["source"] = run.source;
  json["board"] = run.board;
  json["frames"] = run.frames;
  json["frames_with_board"] = run.with_board;
  json["image_size"] = {solution.camera.width, solution.camera.height};
  json["model"] = modelName(solution.lens);
  json["parameters"] = parametersJson(solution);
  json["rms_px"] = solution.rms_px;
  json["points"] = report.points;
  json["left_out_points"] = report.left_out_points;
  json["coverage"] = report.coverage.share();
  json["projection_sigma_px"] = {
      {"mean", report.mean_projection_sigma_px},
      {"worst", report.max_projection_sigma_px},
      {"worst_at", {report.worst_projection_at.x(), report.worst_projection_at.y()}}};
  json["regions"] = regionsJson(report);
  json["views"] = viewsJson(report);
  json["left_out"] = leftOutJson(report);
  return json.dump(1) + "\n";
}

void addCalibrationFiles(const CalibrationRun& run, const CalibrationReport& report,
                         io::OutputDirectory* output) {
  const calibration::Solution& solution = report.solution;
  output->add("calib.yml", io::formatCalibration(solution.measuredCamera()));
  output->add("camera_info.yaml", io::formatCameraInfo(solution.camera, "camera"));
  output->add("calibration.json", calibrationJson(run, report));
  output->add("calibration.png", pictureOf(run, report));
}

}  // namespace waymark::tools
