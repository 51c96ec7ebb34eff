// What to simulate. Every option has its unit in its name, and a default that gives a good camera
// in an ordinary room.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace waymark::simulator {

// Seconds from the start; a frame belongs to it when begin_s <= its mid-exposure < end_s.
struct Interval {
  double begin_s = 0.0;
  double end_s = 0.0;

  [[nodiscard]] bool contains(double time_s) const { return begin_s <= time_s && time_s < end_s; }
};

// The light falls to `factor` (0 .. 1) of itself.
struct Dimming {
  Interval when;
  double factor = 1.0;
};

// From at_s on, the marker hangs `offset_m` (world frame) from where it was.
struct MovedMarker {
  int id = 0;
  double at_s = 0.0;
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
};

// From at_s on, the lens has `factor` times the focal length: an autofocus that has breathed.
struct Refocus {
  double at_s = 0.0;
  double factor = 1.0;
};

struct ImageSize {
  int width = 0;   // pixels
  int height = 0;  // pixels
};

struct Options {
  std::string scene = "walls";  // one of sceneNames()
  std::string dictionary = "ARUCO_MIP_36h12";
  // Where the markers hang, how the hand shakes, textures and noise all follow from it.
  std::uint64_t seed = 1;

  // Empty: the scene's own.
  std::optional<ImageSize> size;
  std::optional<double> rate_hz;
  std::optional<double> duration_s;
  std::optional<double> marker_size_m;

  double psf_sigma_px = 0.6;  // Gaussian blur of lens and sensor, on top of the pixel's own area
  double noise_sigma = 2.0;   // grey levels; 0 for none
  double vignetting = 0.15;   // part of the light lost in the image's corners, 0 .. 1

  double exposure_s = 0.0;   // motion blur; 0 for a flash
  int exposure_samples = 8;  // instants averaged over the exposure; more is smoother and slower
  double readout_s = 0.0;    // rolling shutter: first row to last row; 0 for a global shutter

  // Photographs (jpg, png) for what hangs in the scene, some of them by the seed; empty: posters
  // are made up.
  std::filesystem::path pictures;

  // A fisheye (equidistant) of this field of view across the image's width; empty: the scene's
  // lens.
  std::optional<double> fisheye_deg;
  std::optional<Refocus> refocus;

  std::vector<Interval> blackouts;  // frames without light
  std::vector<Dimming> dimmings;
  std::optional<MovedMarker> moved_marker;
  // The marker of this id is printed twice: the one farthest from it carries its id as well.
  std::optional<int> doubled_id;

  // Empty when usable, else which option is wrong and why. The scene and what depends on it
  // (ids, dictionary) are checked when it is built.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::simulator
