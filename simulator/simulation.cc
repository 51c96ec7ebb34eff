#include "simulator/simulation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "simulator/plane_forms.h"
#include "slam/detection/marker_detection.h"

namespace waymark::simulator {
namespace {

// Is there a surface between the eye and the point? The point's own wall, a hair behind it, is not.
bool occluded(const Scene& scene, double time_s, const Eigen::Vector3d& eye,
              const Eigen::Vector3d& point) {
  constexpr double kSame = 0.9999;  // of the way from the eye to the point
  return std::any_of(scene.surfaces.begin(), scene.surfaces.end(), [&](const Surface& surface) {
    const slam::Transform T_s_w = surface.placeAt(time_s).inverse();
    const Eigen::Vector3d from = T_s_w * eye;
    const Eigen::Vector3d to = T_s_w * point;
    const double s = from.z() / (from.z() - to.z());
    if (!(s > 0.0 && s < kSame)) return false;
    const Eigen::Vector3d hit = from + s * (to - from);
    return std::abs(hit.x()) <= surface.half_width_m && std::abs(hit.y()) <= surface.half_height_m;
  });
}

}  // namespace

Result<std::unique_ptr<const Simulation>> Simulation::create(const Options& options,
                                                             Ending ending) {
  Result<Scene> scene = buildScene(options, ending);
  if (!scene) return scene.error();
  // One pixel more than the blur needs: its outermost rays only give slopes.
  const int margin = Sensor::blurRadius(options) + 1 + smearRadius(scene->largest_smear_px);
  Result<Renderer> renderer = Renderer::create(*scene, options.seed, margin);
  if (!renderer) return renderer.error();
  std::optional<Renderer> refocused;
  if (options.refocus) {
    Scene there = *scene;
    there.camera.fx *= options.refocus->factor;
    there.camera.fy *= options.refocus->factor;
    Result<Renderer> other = Renderer::create(there, options.seed, margin);
    if (!other) return other.error();
    refocused = std::move(*other);
  }
  return std::unique_ptr<const Simulation>(
      new Simulation(options, std::move(*scene), std::move(*renderer), std::move(refocused)));
}

Simulation::Simulation(const Options& options, Scene scene, Renderer renderer,
                       std::optional<Renderer> refocused)
    : options_(options),
      scene_(std::move(scene)),
      renderer_(std::move(renderer)),
      refocused_(std::move(refocused)),
      sensor_(options, {scene_.camera.width, scene_.camera.height}),
      frame_count_(std::max<std::int64_t>(1, std::llround(scene_.duration_s * scene_.rate_hz))) {}

std::vector<Marker> Simulation::markersAt(std::int64_t frame) const {
  std::vector<Marker> markers = scene_.markers;
  const std::optional<MovedMarker>& moved = options_.moved_marker;
  if (moved && timeOf(frame) >= moved->at_s) {
    const auto marker = std::find_if(markers.begin(), markers.end(),
                                     [&](const Marker& m) { return m.id == moved->id; });
    marker->T_w_m.p += moved->offset_m;
  }
  return markers;
}

std::vector<Marker> Simulation::visibleMarkers(std::int64_t frame) const {
  const slam::CameraModel camera(scene_.camera);
  const slam::Transform T_w_c = poseAt(frame);
  const double paper_per_size =
      (scene_.dictionary.cells() + 2.0) / static_cast<double>(scene_.dictionary.cells());
  std::vector<Marker> visible;
  for (const Marker& marker : markersAt(frame)) {
    if ((marker.T_w_m.inverse() * T_w_c.p).z() <= 0.0) continue;
    const auto corners = slam::markerCorners(marker.size_m * paper_per_size);
    const bool whole = std::all_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& p_m) {
      const Eigen::Vector3d p_w = marker.T_w_m * p_m;
      const auto pixel = camera.project(T_w_c.inverse() * p_w);
      return pixel && camera.inImage(*pixel) && !occluded(scene_, timeOf(frame), T_w_c.p, p_w);
    });
    if (whole) visible.push_back(marker);
  }
  return visible;
}

RowPoses Simulation::rowPoses(double mid_time_s) const {
  RowPoses poses;
  poses.first_s = mid_time_s;
  if (options_.readout_s == 0.0) {
    poses.T_w_c.push_back(scene_.trajectory(mid_time_s));
    return poses;
  }
  const int margin = renderer_.rays().margin();
  const int last = scene_.camera.height - 1;
  poses.row_s = options_.readout_s / last;
  poses.first_s -= (margin + 0.5 * last) * poses.row_s;
  for (int row = -margin; row <= last + margin; ++row) {
    const double part = static_cast<double>(row) / last - 0.5;
    poses.T_w_c.push_back(scene_.trajectory(mid_time_s + part * options_.readout_s));
  }
  return poses;
}

Disturbance Simulation::disturbanceAt(double time_s) const {
  return scene_.disturbance ? scene_.disturbance(time_s) : Disturbance{};
}

float Simulation::lightAt(double time_s) const {
  for (const Interval& blackout : options_.blackouts) {
    if (blackout.contains(time_s)) return 0.0F;
  }
  double light = disturbanceAt(time_s).light;
  for (const Dimming& dimming : options_.dimmings) {
    if (dimming.when.contains(time_s)) light *= dimming.factor;
  }
  return static_cast<float>(light);
}

void Simulation::render(std::int64_t frame, Workspace* workspace, std::uint8_t* pixels) const {
  const double time = timeOf(frame);
  const std::vector<Marker> markers = markersAt(frame);
  const int samples = options_.exposure_s > 0.0 ? options_.exposure_samples : 1;
  Radiance& light = workspace->renderer.radiance;
  for (int i = 0; i < samples; ++i) {
    const double part = (i + 0.5) / samples - 0.5;
    const Renderer& renderer =
        refocused_ && time >= options_.refocus->at_s ? *refocused_ : renderer_;
    renderer.render(rowPoses(time + part * options_.exposure_s), markers, &workspace->renderer);
    if (samples == 1) break;
    if (i == 0) {
      workspace->sum = light;
    } else {
      std::transform(light.pixels.begin(), light.pixels.end(), workspace->sum.pixels.begin(),
                     workspace->sum.pixels.begin(), std::plus<>());
    }
  }
  Radiance& exposed = samples == 1 ? light : workspace->sum;
  smearRows(disturbanceAt(time).smear_px, &exposed);
  sensor_.develop(exposed, lightAt(time) / static_cast<float>(samples),
                  static_cast<std::uint64_t>(frame), &workspace->sensor, pixels);
}

}  // namespace waymark::simulator
