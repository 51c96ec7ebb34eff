#include "tools/calibration/report_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

namespace waymark::calibration {
namespace {

constexpr int kPanelWidth = 760;  // pixels
constexpr int kMargin = 24;       // pixels
constexpr int kHeader = 84;       // pixels
const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kMuted(130, 130, 130);
const cv::Scalar kLines(215, 215, 215);
const cv::Scalar kEmpty(205, 210, 250);
const cv::Scalar kPoints(180, 110, 20);
const cv::Scalar kMeans(30, 30, 200);

// One of the two drawings: picture coordinates to the canvas.
struct Panel {
  cv::Point origin;
  double scale = 1.0;

  [[nodiscard]] cv::Point2d at(const Eigen::Vector2d& pixel) const {
    return {origin.x + scale * (pixel.x() + 0.5), origin.y + scale * (pixel.y() + 0.5)};
  }
  [[nodiscard]] cv::Rect cell(const ImageGrid& grid, int index) const {
    const auto edge = [&](int i, int count, int size) {
      return static_cast<int>(std::lround(scale * size * i / count));
    };
    const int column = index % grid.columns;
    const int row = index / grid.columns;
    const cv::Point low(edge(column, grid.columns, grid.width), edge(row, grid.rows, grid.height));
    const cv::Point high(edge(column + 1, grid.columns, grid.width),
                         edge(row + 1, grid.rows, grid.height));
    return {origin + low, origin + high};
  }
};

void write(cv::Mat& canvas, const std::string& text, cv::Point at, double size,
           const cv::Scalar& colour) {
  cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
}

// Lines between whole pixels look like stairs.
void line(cv::Mat& canvas, const cv::Point2d& a, const cv::Point2d& b, const cv::Scalar& colour,
          int thickness) {
  constexpr int kShift = 4;
  const auto fine = [](const cv::Point2d& p) {
    return cv::Point(static_cast<int>(std::lround(p.x * (1 << kShift))),
                     static_cast<int>(std::lround(p.y * (1 << kShift))));
  };
  cv::line(canvas, fine(a), fine(b), colour, thickness, cv::LINE_AA, kShift);
}

void drawCoverage(cv::Mat& canvas, const Panel& panel, const CalibrationReport& report) {
  const ImageGrid& grid = report.coverage.grid();
  for (int cell = 0; cell < grid.cells(); ++cell) {
    const cv::Rect area = panel.cell(grid, cell);
    if (report.coverage.counts()[static_cast<std::size_t>(cell)] == 0) {
      cv::rectangle(canvas, area, kEmpty, cv::FILLED);
    }
    cv::rectangle(canvas, area, kLines, 1);
  }
  for (const Residual& residual : report.residuals) {
    cv::circle(canvas, panel.at(residual.pixel), 2, kPoints, cv::FILLED, cv::LINE_AA);
  }
}

// 1, 2 or 5 times a power of ten.
double roundFactor(double factor) {
  const double power = std::pow(10.0, std::floor(std::log10(factor)));
  const double digit = factor / power;
  return power * (digit >= 5.0 ? 5.0 : (digit >= 2.0 ? 2.0 : 1.0));
}

void drawResiduals(cv::Mat& canvas, const Panel& panel, const CalibrationReport& report,
                   double factor) {
  for (const Residual& residual : report.residuals) {
    const cv::Point2d from = panel.at(residual.pixel);
    const cv::Point2d way(factor * residual.error.x(), factor * residual.error.y());
    line(canvas, from, from + way, kPoints, 1);
  }
  for (int cell = 0; cell < report.regions.cells(); ++cell) {
    const RegionReport& region = report.region_reports[static_cast<std::size_t>(cell)];
    const cv::Rect area = panel.cell(report.regions, cell);
    cv::rectangle(canvas, area, kLines, 1);
    char text[48];
    std::snprintf(text, sizeof text, "%.2f px, %zu", region.rms_px, region.points);
    const cv::Rect plate(area.tl() + cv::Point(2, 2), cv::Size(std::min(108, area.width - 3), 18));
    cv::rectangle(canvas, plate, cv::Scalar::all(255), cv::FILLED);
    write(canvas, region.points == 0 ? "none" : text, area.tl() + cv::Point(5, 15), 0.4, kInk);
    const cv::Point2d middle = 0.5 * cv::Point2d(area.tl() + area.br());
    const cv::Point2d way(factor * region.mean.x(), factor * region.mean.y());
    line(canvas, middle, middle + way, kMeans, 2);
    cv::circle(canvas, middle, 3, kMeans, cv::FILLED, cv::LINE_AA);
  }
}

}  // namespace

cv::Mat drawReport(const CalibrationReport& report, const std::string& title) {
  constexpr double kTypical = 15.0;  // length of an enlarged residual, pixels of the canvas
  const slam::Calibration& camera = report.solution.camera;
  const double scale = static_cast<double>(kPanelWidth) / camera.width;
  const int panel_height = static_cast<int>(std::lround(scale * camera.height));
  cv::Mat canvas(kHeader + panel_height + kMargin, 2 * kPanelWidth + 3 * kMargin, CV_8UC3,
                 cv::Scalar::all(255));
  const Panel left{{kMargin, kHeader}, scale};
  const Panel right{{2 * kMargin + kPanelWidth, kHeader}, scale};
  const double factor = roundFactor(kTypical / std::max(report.solution.rms_px, 1e-4));

  char text[160];
  write(canvas, title, {kMargin, 30}, 0.65, kInk);
  std::snprintf(text, sizeof text, "%zu points of %zu views cover %.0f %%", report.points,
                report.views.size(), 100.0 * report.coverage.share());
  write(canvas, text, {left.origin.x, kHeader - 14}, 0.5, kMuted);
  std::snprintf(text, sizeof text, "residuals, %g canvas pixels for one; means in red; rms %.3f px",
                factor, report.solution.rms_px);
  write(canvas, text, {right.origin.x, kHeader - 14}, 0.5, kMuted);
  drawCoverage(canvas, left, report);
  drawResiduals(canvas, right, report, factor);
  for (const Panel& panel : {left, right}) {
    cv::rectangle(canvas, {panel.origin, cv::Size(kPanelWidth, panel_height)}, kMuted, 1);
  }
  return canvas;
}

}  // namespace waymark::calibration
