// Light arriving at each pixel of one instant: rays against planes. Markers are sampled sixteen
// times per pixel from their code, so that their edges are exact, and prints as often from their
// picture; surfaces once from their paint, or four times along the longer side of the pixel from
// their image, reduced to the shorter one. In scenes with images, the outlines of surfaces are
// sampled sixteen times, too: stairs would be corners to whoever looks for some.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/result.h"
#include "simulator/pixel_on_plane.h"
#include "simulator/ray_table.h"
#include "simulator/scene.h"
#include "simulator/texture.h"

namespace waymark::simulator {

// Where the camera is while each row is read, and when that is.
struct RowPoses {
  // One for the whole image (global shutter), or one for each row of the ray table.
  std::vector<slam::Transform> T_w_c;
  // Of the first row of the ray table, and from one row to the next; only what moves asks for it.
  double first_s = 0.0;
  double row_s = 0.0;

  [[nodiscard]] double timeAt(int row) const { return first_s + row * row_s; }
  [[nodiscard]] const slam::Transform& at(int row) const {
    return T_w_c.size() == 1 ? T_w_c.front() : T_w_c[static_cast<std::size_t>(row)];
  }
};

// Grey levels, with the ray table's margins.
struct Radiance {
  int width = 0;
  int height = 0;
  std::vector<float> pixels;

  [[nodiscard]] float* row(int y) {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
  [[nodiscard]] const float* row(int y) const {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
};

// A surface that a pixel on an outline may show, and the samples that do.
struct SurfaceInPixel {
  int index;
  PixelOnPlane pixel;
  int samples = 0;
  float u = 0.0F;  // their sums, metres on the surface
  float v = 0.0F;
};

// Immutable once made: any number of threads may render, each with its own Workspace.
class Renderer {
 public:
  // Buffers of one thread, reused from frame to frame.
  struct Workspace {
    Radiance radiance;                 // the result
    std::vector<float> inverse_depth;  // of the surface in each pixel, 1 / metres
    std::vector<int> surface;          // in each pixel, -1 for none
    std::vector<float> u, v;           // of one row, metres on the surface
    std::vector<SurfaceInPixel> outline;
  };

  static constexpr double kInk = 35.0;     // grey level of the print
  static constexpr double kPaper = 205.0;  // and of its margin

  // Paints the scene's surfaces. An Error when the lens does not cover the image. The image's
  // margin is what later blurring needs.
  [[nodiscard]] static Result<Renderer> create(const Scene& scene, std::uint64_t seed,
                                               int margin_px);

  // Renders into workspace->radiance. The markers may be elsewhere than in the scene, but are of
  // its dictionary.
  void render(const RowPoses& poses, std::span<const Marker> markers, Workspace* workspace) const;

  [[nodiscard]] const RayTable& rays() const { return rays_; }

 private:
  Renderer(const Scene& scene, std::uint64_t seed, RayTable rays);

  void renderSurfaces(const RowPoses& poses, Workspace* workspace) const;
  void renderSurfaceRow(int row, const RowPoses& poses, std::span<const int> candidates,
                        Workspace* workspace) const;
  // The pixels of a row that look at surfaces with images.
  void renderImageRow(int row, const RowPoses& poses, std::span<const int> candidates,
                      Workspace* workspace) const;
  // The pixels of a row where surfaces meet.
  void renderOutlineRow(int row, const RowPoses& poses, Workspace* workspace) const;
  [[nodiscard]] float sampleOutline(std::span<SurfaceInPixel> there) const;
  // Where a pixel is filled by a surface with an image, about (u, v) metres on it.
  [[nodiscard]] static float sampleImage(const Surface& s, const PixelOnPlane& pixel, float u,
                                         float v);
  void renderMarker(const RowPoses& poses, const Marker& marker, Workspace* workspace) const;
  void renderPrint(const RowPoses& poses, const Print& print, Workspace* workspace) const;
  // Each pixel that looks at a paper's front, nothing in between: sample(u, v, w, behind) says what
  // it sees, from the paper's linear forms there and from what was behind.
  template <typename Sample>
  void renderPaper(const RowPoses& poses, const slam::Transform& T_w_m, double half_width_m,
                   double half_height_m, Workspace* workspace, const Sample& sample) const;

  slam::Dictionary dictionary_;
  slam::CameraModel camera_;
  RayTable rays_;
  std::vector<Surface> surfaces_;
  std::vector<Texture> textures_;  // one for each surface
  bool has_images_;                // some surface does
  std::vector<Print> prints_;
};

}  // namespace waymark::simulator
