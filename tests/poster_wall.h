// A rendered wall with posters, and a fiducial marker where one is wanted; the posters as natural
// markers. Tests only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "simulator/poster.h"
#include "simulator/printed_image.h"
#include "simulator/renderer.h"
#include "simulator/scene.h"
#include "simulator/sensor.h"
#include "slam/map/picture_print.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/picture_points.h"

namespace waymark::testing {

inline constexpr double kPosterWidth_m = 0.30;
inline constexpr double kMarkerSize_m = 0.15;
inline constexpr int kMarker = 7;
inline constexpr double kMarkerX_m = 0.6;

inline std::string nameOf(int poster) { return "poster " + std::to_string(poster); }

inline slam::Calibration lens() {
  slam::Calibration c;
  c.width = 640;
  c.height = 480;
  c.fx = c.fy = 510.0;
  c.cx = 322.0;
  c.cy = 237.0;
  c.distortion = {-0.20, 0.05, 0.0005, -0.0007};
  return c;
}

// A wall in the plane z = 0, x along it, y up; posters every 1.2 m, and a marker between the first
// two.
class PosterWall {
 public:
  explicit PosterWall(int posters) {
    simulator::Scene scene{.name = "wall",
                           .dictionary = *slam::Dictionary::byName("APRILTAG_36h11"),
                           .camera = lens(),
                           .surfaces = {},
                           .markers = {},
                           .prints = {},
                           .trajectory = {}};
    simulator::Surface surface;
    surface.half_width_m = 8.0;
    surface.half_height_m = 3.0;
    surface.paint = {.patches_per_m2 = 6.0, .texel_m = 0.004};
    scene.surfaces.push_back(surface);
    for (int i = 0; i < posters; ++i) {
      const auto poster = posterImage(i);
      const double height_m = kPosterWidth_m * poster.height / poster.width;
      slam::Transform T_w_p;
      T_w_p.p = {1.2 * i, 0.1 * (i % 2), 0.002};
      T_w_m_.push_back(T_w_p);
      scene.prints.push_back({std::make_shared<simulator::PrintedImage>(poster.view()),
                              kPosterWidth_m, height_m, T_w_p});
      markers_.push_back(*slam::NaturalMarker::create(poster.view(), kPosterWidth_m, 0.0));
    }
    marker_ = {kMarker, kMarkerSize_m, {}};
    marker_.T_w_m.p = {kMarkerX_m, -0.1, 0.002};
    simulator::Options options;
    renderer_.emplace(
        *simulator::Renderer::create(scene, 1, simulator::Sensor::blurRadius(options) + 1));
    sensor_.emplace(options, simulator::ImageSize{640, 480});
  }

  [[nodiscard]] const std::vector<std::uint8_t>& render(const slam::Transform& T_w_c,
                                                        bool with_marker, std::uint64_t number) {
    std::vector<simulator::Marker> markers;
    if (with_marker) markers.push_back(marker_);
    renderer_->render({{T_w_c}}, markers, &workspace_);
    pixels_.resize(640U * 480U);
    sensor_->develop(workspace_.radiance, 1.0F, number, &sensing_, pixels_.data());
    return pixels_;
  }

  // The first so many of them are surveyed.
  [[nodiscard]] std::vector<slam::PicturePrint> prints(int surveyed) const {
    std::vector<slam::PicturePrint> prints;
    for (std::size_t i = 0; i < markers_.size(); ++i) {
      prints.push_back(
          {.name = nameOf(static_cast<int>(i)),
           .width_m = markers_[i].width_m(),
           .height_m = markers_[i].height_m(),
           .T_w_m = static_cast<int>(i) < surveyed ? std::optional(T_w_m_[i]) : std::nullopt,
           .points_m = slam::picturePoints(markers_[i])});
    }
    return prints;
  }
  [[nodiscard]] std::vector<slam::PosedNaturalMarker> pictures() const {
    std::vector<slam::PosedNaturalMarker> pictures;
    for (std::size_t i = 0; i < markers_.size(); ++i) {
      pictures.push_back({slam::pictureId(nameOf(static_cast<int>(i))), markers_[i], {}});
    }
    return pictures;
  }
  [[nodiscard]] const slam::Transform& placeOf(int poster) const {
    return T_w_m_[static_cast<std::size_t>(poster)];
  }
  [[nodiscard]] static simulator::PosterImage posterImage(int poster) {
    return simulator::makePoster(100U + static_cast<unsigned>(poster));
  }
  [[nodiscard]] const slam::Transform& marker() const { return marker_.T_w_m; }

 private:
  std::vector<slam::NaturalMarker> markers_;
  std::vector<slam::Transform> T_w_m_;
  simulator::Marker marker_;
  std::optional<simulator::Renderer> renderer_;
  std::optional<simulator::Sensor> sensor_;
  simulator::Renderer::Workspace workspace_;
  simulator::Sensor::Workspace sensing_;
  std::vector<std::uint8_t> pixels_;
};

// At (x, 0.05, distance), turned towards the wall and a little along it.
inline slam::Transform facingWall(double x_m, double distance_m, double turn_rad) {
  slam::Transform T_w_c;
  T_w_c.R << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  T_w_c.R = slam::expSo3({0.05, turn_rad, 0.0}) * T_w_c.R;
  T_w_c.p = {x_m, 0.05, distance_m};
  return T_w_c;
}

}  // namespace waymark::testing
