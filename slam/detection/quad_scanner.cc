#include "slam/detection/quad_scanner.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

namespace waymark::slam {
namespace {

// Least-squares line (n, c) with n . p + c = 0 and |n| = 1 through part of a closed outline: the
// points from index `from` on, `count` of them, without the share at either end that bends around
// the corner.
Eigen::Vector3d fitLine(const std::vector<cv::Point>& outline, std::size_t from,
                        std::size_t count) {
  const std::size_t skip = count / 8;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
  for (std::size_t i = skip; i < count - skip; ++i) {
    const cv::Point& point = outline[(from + i) % outline.size()];
    const Eigen::Vector2d p(point.x, point.y);
    sum += p;
    squares += p * p.transpose();
  }
  const double n = static_cast<double>(count - 2 * skip);
  const Eigen::Vector2d mean = sum / n;
  const Eigen::Matrix2d scatter = squares / n - mean * mean.transpose();
  // The direction of least scatter.
  const double angle =
      0.5 * std::atan2(2.0 * scatter(0, 1), scatter(0, 0) - scatter(1, 1)) + 0.5 * CV_PI;
  const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
  return {normal.x(), normal.y(), -normal.dot(mean)};
}

// The quad whose sides are lines through the outline between the polygon's vertices, clockwise in
// the image (y down). Empty when it is degenerate.
std::optional<Quad> fitQuad(const std::vector<cv::Point>& outline,
                            const std::vector<cv::Point>& polygon) {
  std::array<std::size_t, 4> vertex{};
  for (std::size_t k = 0; k < 4; ++k) {
    vertex[k] = static_cast<std::size_t>(std::find(outline.begin(), outline.end(), polygon[k]) -
                                         outline.begin());
  }
  std::array<Eigen::Vector3d, 4> lines;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t count = (vertex[(k + 1) % 4] + outline.size() - vertex[k]) % outline.size();
    if (count < 4) return std::nullopt;
    lines[k] = fitLine(outline, vertex[k], count);
  }
  Quad quad;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d meet = lines[(k + 3) % 4].cross(lines[k]);
    quad[k] = meet.head<2>() / meet.z();
    constexpr double kFarthest = 6.0;  // pixels between a vertex and where its sides meet
    if (!((quad[k] - Eigen::Vector2d(polygon[k].x, polygon[k].y)).norm() < kFarthest)) {
      return std::nullopt;
    }
  }
  const Eigen::Vector2d a = quad[2] - quad[0];
  const Eigen::Vector2d b = quad[3] - quad[1];
  if (a.x() * b.y() - a.y() * b.x() < 0.0) std::swap(quad[1], quad[3]);
  return quad;
}

// The outline runs through light pixels just outside the dark square; the edge is half a pixel in.
void shrink(Quad* quad, double distance_px) {
  const Eigen::Vector2d centre = 0.25 * ((*quad)[0] + (*quad)[1] + (*quad)[2] + (*quad)[3]);
  for (Eigen::Vector2d& corner : *quad) {
    const Eigen::Vector2d inward = centre - corner;
    const double length = inward.norm();
    if (length > 2.0 * distance_px) corner += inward * (distance_px * std::sqrt(2.0) / length);
  }
}

}  // namespace

QuadScanner::QuadScanner(const QuadScannerOptions& options) : options_(options), dark_below_{} {
  for (std::size_t mean = 0; mean < dark_below_.size(); ++mean) {
    const double level =
        static_cast<double>(mean) * (1.0 - options.threshold_share) - options.threshold_offset;
    dark_below_[mean] = static_cast<std::uint8_t>(std::clamp(level, 0.0, 255.0));
  }
}

const std::vector<Quad>& QuadScanner::scan(const ImageView& image) {
  const cv::Mat grey(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                     static_cast<std::size_t>(image.stride));
  const int window = options_.threshold_window_px;
  cv::boxFilter(grey, mean_, CV_8U, {window, window});
  light_.create(grey.size(), CV_8U);
  for (int y = 0; y < grey.rows; ++y) {
    const std::uint8_t* in = grey.ptr(y);
    const std::uint8_t* mean = mean_.ptr(y);
    std::uint8_t* out = light_.ptr(y);
    for (int x = 0; x < grey.cols; ++x) {
      out[x] = in[x] >= dark_below_[mean[x]] ? 255 : 0;
    }
  }
  // Dark squares are sought as holes in the light: holes are 4-connected, so that squares touching
  // at their corners, as on a chessboard, stay apart.
  cv::findContours(light_, outlines_, hierarchy_, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  collectQuads();
  const double margin = options_.border_margin_px;
  std::erase_if(quads_, [&](const Quad& quad) {
    return std::any_of(quad.begin(), quad.end(), [&](const Eigen::Vector2d& c) {
      return c.x() < margin || c.y() < margin || c.x() > image.width - 1 - margin ||
             c.y() > image.height - 1 - margin;
    });
  });
  return quads_;
}

void QuadScanner::collectQuads() {
  quads_.clear();
  const auto min_points = static_cast<std::size_t>(4.0 * options_.min_side_px * 0.7);
  for (std::size_t i = 0; i < outlines_.size(); ++i) {
    const bool is_hole = hierarchy_[i][3] >= 0;
    if (!is_hole || outlines_[i].size() < min_points) continue;
    const double perimeter = static_cast<double>(outlines_[i].size());
    cv::approxPolyDP(outlines_[i], polygon_, std::max(1.5, options_.outline_tolerance * perimeter),
                     true);
    if (polygon_.size() != 4 || !cv::isContourConvex(polygon_)) continue;
    std::optional<Quad> quad = fitQuad(outlines_[i], polygon_);
    if (!quad) continue;
    double shortest = ((*quad)[3] - (*quad)[0]).norm();
    for (std::size_t k = 0; k < 3; ++k) {
      shortest = std::min(shortest, ((*quad)[k + 1] - (*quad)[k]).norm());
    }
    if (shortest < options_.min_side_px) continue;
    shrink(&*quad, 0.5);
    quads_.push_back(*quad);
  }
}

}  // namespace waymark::slam
