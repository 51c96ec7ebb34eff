// Pictures of a board through a known camera, for the tests.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "base/image_view.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "tools/calibration/board.h"

namespace waymark::calibration::testing {

// A board that is lit evenly, and the wall behind it.
class DrawnBoard {
 public:
  explicit DrawnBoard(const BoardOptions& options)
      : options_(options), dictionary_(*slam::Dictionary::byName(options.dictionary)) {}

  // x and y in the board's frame, metres.
  [[nodiscard]] bool black(double x, double y) const {
    const double u = x / options_.square_size_m + 0.5 * options_.columns;
    const double v = 0.5 * options_.rows - y / options_.square_size_m;
    const int column = static_cast<int>(std::floor(u));
    const int row = static_cast<int>(std::floor(v));
    if (column < 0 || row < 0 || column >= options_.columns || row >= options_.rows) return false;
    const bool charuco = options_.kind == BoardKind::kCharuco;
    if (charuco && (row + column) % 2 == 0) return true;
    // In cells of the marker in the middle of this square.
    const double share = options_.marker_size_m / options_.square_size_m;
    const auto cell = [&](double in_square) {
      return static_cast<int>(
          std::floor((in_square - 0.5 * (1.0 - share)) / share * dictionary_.cells()));
    };
    const int i = cell(v - row);
    const int j = cell(u - column);
    if (i < 0 || j < 0 || i >= dictionary_.cells() || j >= dictionary_.cells()) return false;
    const int place = row * options_.columns + column;
    // In a chessboard every second square has a marker, and the first one has none.
    return !dictionary_.white(options_.first_id + (charuco ? place / 2 : place), i, j);
  }

 private:
  BoardOptions options_;
  slam::Dictionary dictionary_;
};

// A camera that takes pictures: pixels gather light over their area, the lens blurs a little, and
// there is noise.
class Photographer {
 public:
  explicit Photographer(const slam::Calibration& calibration) : camera_(calibration) {
    // Directions of the pixels' corners.
    rays_.reserve(static_cast<std::size_t>((camera_.width() + 1) * (camera_.height() + 1)));
    for (int y = 0; y <= camera_.height(); ++y) {
      for (int x = 0; x <= camera_.width(); ++x) {
        const auto ray = camera_.undistort({x - 0.5, y - 0.5});
        rays_.push_back(ray.value_or(Eigen::Vector2d(1e6, 1e6)));
      }
    }
  }

  [[nodiscard]] const slam::CameraModel& camera() const { return camera_; }

  // 8-bit grey. blur_px: of the lens, standard deviation.
  [[nodiscard]] cv::Mat take(const DrawnBoard& board, const slam::Transform& T_c_b,
                             double blur_px = 0.6, double noise = 1.5, unsigned seed = 1) const {
    constexpr int kSamples = 3;  // along either side of a pixel
    // From directions to the board's plane.
    Eigen::Matrix3d from_board;
    from_board << T_c_b.R.col(0), T_c_b.R.col(1), T_c_b.p;
    const Eigen::Matrix3d to_board = from_board.inverse();
    cv::Mat_<float> picture(camera_.height(), camera_.width());
    for (int y = 0; y < camera_.height(); ++y) {
      for (int x = 0; x < camera_.width(); ++x) {
        int black = 0;
        for (int s = 0; s < kSamples * kSamples; ++s) {
          const double a = (s % kSamples + 0.5) / kSamples;
          const int row = s / kSamples;
          const double b = (row + 0.5) / kSamples;
          const Eigen::Vector2d ray = (1 - b) * ((1 - a) * at(x, y) + a * at(x + 1, y)) +
                                      b * ((1 - a) * at(x, y + 1) + a * at(x + 1, y + 1));
          const Eigen::Vector3d p = to_board * ray.homogeneous();
          if (p.z() > 0.0 && board.black(p.x() / p.z(), p.y() / p.z())) ++black;
        }
        picture(y, x) = 200.0F - 160.0F * static_cast<float>(black) / (kSamples * kSamples);
      }
    }
    cv::GaussianBlur(picture, picture, {}, blur_px);
    std::mt19937 rng(seed);
    std::normal_distribution<float> grain(0.0F, static_cast<float>(noise));
    for (float& value : picture) value += grain(rng);
    cv::Mat grey;
    picture.convertTo(grey, CV_8U);
    return grey;
  }

 private:
  [[nodiscard]] const Eigen::Vector2d& at(int x, int y) const {
    return rays_[static_cast<std::size_t>(y * (camera_.width() + 1) + x)];
  }

  slam::CameraModel camera_;
  std::vector<Eigen::Vector2d> rays_;
};

[[nodiscard]] inline ImageView viewOf(const cv::Mat& grey) {
  return {grey.data, grey.cols, grey.rows, static_cast<std::ptrdiff_t>(grey.step)};
}

// The board's pose where its centre appears at `pixel`, `distance_m` away, first turned in its
// plane by `roll`, then tilted about the picture's x and y axes; radians. Upright and facing the
// camera where all three are 0.
[[nodiscard]] inline slam::Transform boardAt(const slam::CameraModel& camera,
                                             const Eigen::Vector2d& pixel, double distance_m,
                                             double tilt_x, double tilt_y, double roll = 0.0) {
  const Eigen::Vector3d ray = camera.undistort(pixel)->homogeneous();
  slam::Transform T;
  T.R = slam::expSo3({tilt_x, 0, 0}) * slam::expSo3({0, tilt_y, 0}) * slam::expSo3({0, 0, roll}) *
        Eigen::Vector3d(1, -1, -1).asDiagonal();
  T.p = distance_m * ray.normalized();
  return T;
}

// Poses as a careful person shows a board: all over the picture, near and far, tilted to all sides.
[[nodiscard]] inline std::vector<slam::Transform> goodPoses(const slam::CameraModel& camera,
                                                            double distance_m, int count,
                                                            unsigned seed = 5) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<slam::Transform> poses;
  for (int i = 0; i < count; ++i) {
    const double x = 0.15 + 0.7 * (i % 4) / 3.0;
    const double y = 0.2 + 0.6 * (i / 4 % 3) / 2.0;
    const double towards = 2.0 * std::numbers::pi * unit(rng);
    const double tilt = 0.3 + 0.4 * unit(rng);
    poses.push_back(boardAt(camera, {x * camera.width(), y * camera.height()},
                            distance_m * (0.8 + 0.6 * unit(rng)), tilt * std::cos(towards),
                            tilt * std::sin(towards), 0.5 * (unit(rng) - 0.5)));
  }
  return poses;
}

}  // namespace waymark::calibration::testing
