// A camera from collected views: measured twice, without the views and corners that do not fit, and
// with everything that shows how good it is.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.h"
#include "tools/calibration/camera_solver.h"
#include "tools/calibration/coverage.h"
#include "tools/calibration/view_collector.h"

namespace waymark::calibration {

struct CalibratorOptions {
  SolverOptions solver;
  BoardDetectorOptions detector;
  // A corner that is this many standard deviations off is left out.
  double corner_gate = 6.0;
  // A view is left out where its residuals are this many times the median view's, and ...
  double view_gate = 2.5;
  // ... root mean square at least this large, pixels: no exact view is an outlier.
  double view_floor_px = 0.15;
  int max_rounds = 8;  // of leaving out and solving again

  // What views must give before a camera is believed.
  std::size_t min_views = 6;
  double min_coverage = 0.4;       // share of the picture's cells with a point
  double min_tilt_rad = 0.25;      // of the board in the view that tilts it most; 14 degrees
  double max_focal_sigma = 0.005;  // of the focal length
  // Of k4, where there is one: beyond it numerator and denominator cancel each other.
  double max_rational_sigma = 5.0;
  // Standard deviation with which a point anywhere in the picture would be predicted, as a share of
  // the picture's width: 2 pixels at 640.
  double max_projection_sigma = 0.003;
};

// A view that took part.
struct ViewReport {
  std::string name;
  std::size_t points = 0;
  double rms_px = 0.0;
  double tilt_rad = 0.0;    // between the board's normal and the optical axis
  double distance_m = 0.0;  // to the board's centre
};

struct LeftOutView {
  std::string name;
  std::string reason;
};

// A cell of the picture.
struct RegionReport {
  std::size_t points = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();  // projected less seen, pixels
  double rms_px = 0.0;
};

struct Residual {
  Eigen::Vector2d pixel;  // where the point was seen
  Eigen::Vector2d error;  // projected less seen, pixels
};

struct CalibrationReport {
  Solution solution;
  std::vector<ViewReport> views;
  std::vector<LeftOutView> left_out;
  std::size_t points = 0;
  std::size_t left_out_points = 0;
  ImageGrid regions;  // of region_reports
  std::vector<RegionReport> region_reports;
  Coverage coverage;  // of the points that took part
  std::vector<Residual> residuals;
  // How well the camera is known where it matters: standard deviation of a point's prediction, in
  // pixels, after the best rotation; the mean over the picture and the worst, and where that is.
  double mean_projection_sigma_px = 0.0;
  double max_projection_sigma_px = 0.0;
  Eigen::Vector2d worst_projection_at = Eigen::Vector2d::Zero();
};

// An Error is one line that says what the views lack.
[[nodiscard]] Result<CalibrationReport> calibrateCamera(const Board& board, std::vector<View> views,
                                                        Lens lens,
                                                        const CalibratorOptions& options = {});

}  // namespace waymark::calibration
