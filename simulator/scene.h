// What there is to see: flat textured surfaces, markers on them, and a camera on its way. A scene
// is only a description; nothing in it is rendered yet.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "simulator/options.h"
#include "simulator/poster.h"
#include "simulator/printed_image.h"
#include "simulator/trajectory.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::simulator {

// How a surface is painted; grey levels as they reach the sensor in full light.
struct Paint {
  double mean = 150.0;          // grey level
  double contrast = 22.0;       // of the smooth noise, grey levels
  double patches_per_m2 = 1.2;  // posters, papers, stains: the natural features
  double patch_size_m = 0.25;   // their typical side
  double noise_wavelength_m = 0.5;
  double texel_m = 0.005;
};

// A rectangle, seen from both sides. Its frame: origin at the centre, x right, y up, z out.
struct Surface {
  slam::Transform T_w_s;
  double half_width_m = 0.0;
  double half_height_m = 0.0;
  Paint paint;
  // Where there is one, it covers the surface from edge to edge, instead of the paint. On the back
  // it is seen as through glass.
  std::shared_ptr<const PrintedImage> image;
  // T_w_s of a surface that moves; empty: it stays where it is.
  Trajectory motion;

  [[nodiscard]] slam::Transform placeAt(double time_s) const {
    return motion ? motion(time_s) : T_w_s;
  }
};

// A printed marker: the black square of `size_m` within a white margin of one cell. It is seen from
// its front only. Truth: where it is at time 0.
struct Marker {
  int id = 0;
  double size_m = 0.0;
  slam::Transform T_w_m;
};

// A picture on paper, to its edges; seen from its front only.
struct Print {
  std::shared_ptr<const PrintedImage> image;
  double width_m = 0.0;
  double height_m = 0.0;
  slam::Transform T_w_p;  // origin at its centre, x right, y up, z out of the print
};

// A picture that users would know as a natural marker.
struct NaturalPicture {
  std::string name;
  PosterImage picture;
  double width_m = 0.0;
  double height_m = 0.0;
  std::optional<slam::Transform> T_w_m{};  // empty: it hangs nowhere in the scene
};

// A point whose place is known exactly.
struct Target {
  std::string name;
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  // metres
};

// What the image suffers at a moment, beside what the options ask for.
struct Disturbance {
  double light = 1.0;     // 1 in full light, 0 in darkness
  double smear_px = 0.0;  // a knock while exposing: how far the image moves along its rows
};

// What happens when, for whoever measures.
struct Event {
  std::string what;
  Interval when;
};

struct Scene {
  std::string name;
  slam::Dictionary dictionary;
  slam::Calibration camera;
  double rate_hz = 0.0;
  double duration_s = 0.0;
  std::vector<Surface> surfaces;
  std::vector<Marker> markers;
  std::vector<Print> prints;
  Trajectory trajectory;
  // Most scenes have none of these.
  std::vector<NaturalPicture> natural{};
  std::vector<Target> targets{};
  std::vector<Event> events{};
  std::function<Disturbance(double time_s)> disturbance{};
  double largest_smear_px = 0.0;  // of all disturbances
};

// Every scene, with a line for people.
struct SceneInfo {
  std::string name;
  std::string description;
};
[[nodiscard]] const std::vector<SceneInfo>& sceneList();

// How the motion ends: as the scene has it, or back where it began, ready to be repeated forever.
enum class Ending { kOfTheScene, kClosedLoop };

// Checks the options as well: an Error says which one is wrong and why.
[[nodiscard]] Result<Scene> buildScene(const Options& options, Ending ending);

}  // namespace waymark::simulator
