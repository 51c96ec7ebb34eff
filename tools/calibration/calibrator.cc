#include "tools/calibration/calibrator.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <utility>

#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "tools/calibration/projection_sigma.h"

namespace waymark::calibration {
namespace {

// What is left of the views, and what was taken out of them.
struct Selection {
  std::vector<std::string> names;
  std::vector<std::vector<BoardPoint>> points;
  std::vector<LeftOutView> left_out;
  std::size_t left_out_points = 0;

  void leaveOut(std::size_t view, std::string reason) {
    left_out.push_back({names[view], std::move(reason)});
    names.erase(names.begin() + static_cast<std::ptrdiff_t>(view));
    points.erase(points.begin() + static_cast<std::ptrdiff_t>(view));
  }
};

std::string text(const char* format, double a, double b = 0.0) {
  char line[160];
  std::snprintf(line, sizeof line, format, a, b);
  return line;
}

Selection selectionOf(std::vector<View>& views) {
  Selection selection;
  for (View& view : views) {
    selection.names.push_back(view.name);
    selection.points.push_back(view.board_view.points);
  }
  return selection;
}

// With a camera that is nearly right the sides of markers are straight lines.
void measureAgain(const Board& board, const slam::Calibration& camera,
                  const BoardDetectorOptions& options, std::vector<View>* views) {
  BoardDetector detector(board, camera, options);
  for (View& view : *views) {
    if (auto board_view = detector.detect(view.image())) view.board_view = std::move(*board_view);
  }
}

// Takes out views that are far worse than the others. False when there are none.
bool leaveOutViews(const Solution& solution, const CalibratorOptions& options,
                   Selection* selection) {
  std::vector<double> all;
  for (const SolvedView& view : solution.views) all.push_back(view.rms_px);
  const double limit_px =
      std::max(options.view_floor_px, options.view_gate * slam::median(std::move(all)));
  bool any = false;
  for (std::size_t v = solution.views.size(); v-- > 0;) {
    const double rms_px = solution.views[v].rms_px;
    if (rms_px <= limit_px) continue;
    selection->leaveOut(v, text("%.2f px rms, the limit is %.2f", rms_px, limit_px));
    any = true;
  }
  return any;
}

// Takes out single corners, and views that would lose too many. False when there are none.
bool leaveOutCorners(const Solution& solution, const CalibratorOptions& options,
                     Selection* selection) {
  constexpr double kMaxShare = 0.25;
  const double gate = options.corner_gate * solution.noise;
  bool any = false;
  for (std::size_t v = solution.views.size(); v-- > 0;) {
    const std::vector<BoardPoint>& before = selection->points[v];
    std::vector<BoardPoint> left;
    for (std::size_t i = 0; i < before.size(); ++i) {
      const Eigen::Vector2d r = solution.views[v].residuals[i];
      const bool fits = (slam::whitening(before[i].covariance) * r).norm() <= gate ||
                        r.norm() <= options.view_floor_px;
      if (fits) left.push_back(before[i]);
    }
    const std::size_t lost = before.size() - left.size();
    if (lost == 0) continue;
    any = true;
    if (static_cast<double>(lost) > kMaxShare * static_cast<double>(before.size())) {
      selection->leaveOut(v, text("%.0f of %.0f corners do not fit", static_cast<double>(lost),
                                  static_cast<double>(before.size())));
    } else {
      selection->left_out_points += lost;
      selection->points[v] = std::move(left);
    }
  }
  return any;
}

std::optional<Solution> solveWithoutOutliers(const Board& board, int width, int height, Lens lens,
                                             const CalibratorOptions& options,
                                             Selection* selection) {
  std::optional<Solution> solution;
  for (int round = 0; round < options.max_rounds; ++round) {
    solution = solveCamera(board.points(), selection->points, width, height, lens, options.solver);
    if (!solution) return std::nullopt;
    // Whole views first: without them single corners may fit again.
    if (!leaveOutViews(*solution, options, selection) &&
        !leaveOutCorners(*solution, options, selection)) {
      return solution;
    }
  }
  return solveCamera(board.points(), selection->points, width, height, lens, options.solver);
}

double tiltOf(const slam::Transform& T_c_b) {
  return std::acos(std::min(1.0, std::abs(T_c_b.R(2, 2))));
}

void summarizeRegions(CalibrationReport* report) {
  std::vector<double> squared(static_cast<std::size_t>(report->regions.cells()), 0.0);
  report->region_reports.resize(squared.size());
  for (const Residual& residual : report->residuals) {
    const auto cell = static_cast<std::size_t>(report->regions.cellOf(residual.pixel));
    RegionReport& region = report->region_reports[cell];
    ++region.points;
    region.mean += residual.error;
    squared[cell] += residual.error.squaredNorm();
  }
  for (std::size_t cell = 0; cell < squared.size(); ++cell) {
    RegionReport& region = report->region_reports[cell];
    if (region.points == 0) continue;
    const auto count = static_cast<double>(region.points);
    region.mean /= count;
    region.rms_px = std::sqrt(squared[cell] / count);
  }
}

CalibrationReport reportOf(Solution solution, Selection selection) {
  constexpr int kRegionColumns = 5;
  constexpr int kRegionRows = 4;
  const slam::Calibration& camera = solution.camera;
  CalibrationReport report{.solution = {},
                           .views = {},
                           .left_out = std::move(selection.left_out),
                           .left_out_points = selection.left_out_points,
                           .regions = {camera.width, camera.height, kRegionColumns, kRegionRows},
                           .region_reports = {},
                           .coverage = Coverage(camera.width, camera.height),
                           .residuals = {}};
  for (std::size_t v = 0; v < solution.views.size(); ++v) {
    const SolvedView& view = solution.views[v];
    const std::vector<BoardPoint>& points = selection.points[v];
    report.views.push_back(
        {selection.names[v], points.size(), view.rms_px, tiltOf(view.T_c_b), view.T_c_b.p.norm()});
    report.points += points.size();
    for (std::size_t i = 0; i < points.size(); ++i) {
      report.coverage.add(points[i].pixel);
      report.residuals.push_back({points[i].pixel, view.residuals[i]});
    }
  }
  summarizeRegions(&report);
  const ProjectionSigma sigma = projectionSigma(solution);
  report.mean_projection_sigma_px = sigma.mean_px;
  report.max_projection_sigma_px = sigma.worst_px;
  report.worst_projection_at = sigma.worst_at;
  report.solution = std::move(solution);
  return report;
}

// What the views lack; empty when they determine the camera.
std::string lack(const CalibrationReport& report, const CalibratorOptions& options) {
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  std::vector<std::string> reasons;
  const slam::Calibration& camera = report.solution.camera;
  if (report.views.size() < options.min_views) {
    reasons.push_back(text("only %.0f views are left, at least %.0f are needed",
                           static_cast<double>(report.views.size()),
                           static_cast<double>(options.min_views)));
  }
  double tilt_rad = 0.0;
  for (const ViewReport& view : report.views) tilt_rad = std::max(tilt_rad, view.tilt_rad);
  if (tilt_rad < options.min_tilt_rad) {
    reasons.push_back(
        text("no view tilts the board by more than %.0f degrees; 30 and more to "
             "several sides are good",
             kDegrees * tilt_rad));
  }
  if (report.coverage.share() < options.min_coverage) {
    reasons.push_back(
        text("the points cover %.0f %% of the picture", 100.0 * report.coverage.share()) +
        ", too few in: " + report.coverage.missing());
  }
  const double focal_sigma =
      std::max(report.solution.sigma(0) / camera.fx, report.solution.sigma(1) / camera.fy);
  if (!(focal_sigma <= options.max_focal_sigma)) {
    reasons.push_back(std::isfinite(focal_sigma)
                          ? text("the focal length is known to %.2g %% only", 100.0 * focal_sigma)
                          : "the focal length is not determined");
  }
  if (!(report.max_projection_sigma_px <= options.max_projection_sigma * camera.width) &&
      std::isfinite(focal_sigma)) {
    const bool said = report.coverage.share() < options.min_coverage;
    const std::string missing = said ? "" : report.coverage.missing();
    reasons.push_back(text("the lens at (%.0f, %.0f)", report.worst_projection_at.x(),
                           report.worst_projection_at.y()) +
                      text(" is known to %.2g px only", report.max_projection_sigma_px) +
                      (missing.empty() ? "" : "; hardly a point is in: " + missing));
  }
  constexpr Eigen::Index kFirstOfDenominator = 9;  // k4
  if (report.solution.lens == Lens::kRational &&
      !(report.solution.sigma(kFirstOfDenominator) <= options.max_rational_sigma)) {
    reasons.emplace_back(
        "a rational lens has more coefficients than they determine; try plumb_bob");
  }
  std::string all;
  for (const std::string& reason : reasons) all += (all.empty() ? "" : "; ") + reason;
  return all;
}

}  // namespace

Result<CalibrationReport> calibrateCamera(const Board& board, std::vector<View> views, Lens lens,
                                          const CalibratorOptions& options) {
  const std::string begin = "the views do not determine the camera: ";
  if (views.size() < options.min_views) {
    return Error{begin + text("the board is in %.0f different ones, at least %.0f are needed",
                              static_cast<double>(views.size()),
                              static_cast<double>(options.min_views))};
  }
  const int width = views.front().width;
  const int height = views.front().height;
  const Error no_camera{begin + "no camera with such a lens explains them"};
  Selection rough = selectionOf(views);
  const auto first = solveWithoutOutliers(board, width, height, lens, options, &rough);
  if (!first) return no_camera;
  measureAgain(board, first->camera, options.detector, &views);
  Selection selection = selectionOf(views);
  auto solution = solveWithoutOutliers(board, width, height, lens, options, &selection);
  if (!solution || solution->views.empty()) return no_camera;
  CalibrationReport report = reportOf(std::move(*solution), std::move(selection));
  if (const std::string reasons = lack(report, options); !reasons.empty()) {
    return Error{begin + reasons};
  }
  return report;
}

}  // namespace waymark::calibration
