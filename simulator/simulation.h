// A simulated sequence: any frame's image and truth, in any order.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/result.h"
#include "simulator/options.h"
#include "simulator/renderer.h"
#include "simulator/scene.h"
#include "simulator/sensor.h"

namespace waymark::simulator {

// Immutable once made: any number of threads may render frames, each with its own Workspace.
//
// Frame k is taken at k / rate seconds. Its time and pose are those of the middle row's
// mid-exposure. World frame: the scene's (on the floor or the table, z up; see scene_*.cc).
class Simulation {
 public:
  // Buffers of one thread, reused from frame to frame.
  struct Workspace {
    Renderer::Workspace renderer;
    Sensor::Workspace sensor;
    Radiance sum;  // over the exposure
  };

  // An Error says which option is wrong and why.
  [[nodiscard]] static Result<std::unique_ptr<const Simulation>> create(const Options& options,
                                                                        Ending ending);

  [[nodiscard]] const Options& options() const { return options_; }
  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] const slam::Calibration& camera() const { return scene_.camera; }
  [[nodiscard]] std::int64_t frameCount() const { return frame_count_; }
  [[nodiscard]] double timeOf(std::int64_t frame) const {  // seconds
    return static_cast<double>(frame) / scene_.rate_hz;
  }

  // The truth: T_w_c of a frame, and the markers. markers() are where they are at the start; a
  // doubled id is listed twice, the original first.
  [[nodiscard]] slam::Transform poseAt(std::int64_t frame) const {
    return scene_.trajectory(timeOf(frame));
  }
  [[nodiscard]] const std::vector<Marker>& markers() const { return scene_.markers; }
  [[nodiscard]] std::vector<Marker> markersAt(std::int64_t frame) const;

  // Within a blackout, or dimmed to next to nothing.
  [[nodiscard]] bool isDark(std::int64_t frame) const {
    constexpr float kDark = 0.03F;  // what is white has grey level 6 then
    return lightAt(timeOf(frame)) <= kDark;
  }

  // Markers whose paper is wholly in the image, facing the camera, with nothing in between.
  [[nodiscard]] std::vector<Marker> visibleMarkers(std::int64_t frame) const;

  // Fills camera().width * camera().height bytes, row after row. The same bytes for the same frame
  // of the same options, whatever was rendered before.
  void render(std::int64_t frame, Workspace* workspace, std::uint8_t* pixels) const;

 private:
  Simulation(const Options& options, Scene scene, Renderer renderer,
             std::optional<Renderer> refocused);

  [[nodiscard]] RowPoses rowPoses(double mid_time_s) const;
  [[nodiscard]] Disturbance disturbanceAt(double time_s) const;
  // 1 in full light, 0 in a blackout.
  [[nodiscard]] float lightAt(double time_s) const;

  Options options_;
  Scene scene_;
  Renderer renderer_;
  std::optional<Renderer> refocused_;  // through the lens as it is later
  Sensor sensor_;
  std::int64_t frame_count_;
};

}  // namespace waymark::simulator
