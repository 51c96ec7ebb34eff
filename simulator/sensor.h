// From light to grey levels: point spread, vignetting, dimming, noise, eight bits.
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/options.h"
#include "simulator/renderer.h"

namespace waymark::simulator {

class Sensor {
 public:
  Sensor(const Options& options, const ImageSize& size);

  // How many pixels beyond the image the blur reaches.
  [[nodiscard]] static int blurRadius(const Options& options);

  // Buffers of one thread, reused from frame to frame.
  struct Workspace {
    std::vector<float> column_blurred;
    std::vector<float> row;
  };

  // Develops the light (with a margin of at least blurRadius()) into size.width x size.height
  // pixels without gaps. `light` scales it. The noise depends on the seed and the frame only.
  void develop(const Radiance& radiance, float light, std::uint64_t frame, Workspace* workspace,
               std::uint8_t* pixels) const;

 private:
  // One image row, blurred both ways, into workspace->row.
  void blurRow(const Radiance& radiance, int row, Workspace* workspace) const;

  ImageSize size_;
  std::uint64_t seed_;
  std::vector<float> taps_;        // of the blur, from the middle outwards
  std::vector<float> vignetting_;  // factor of each pixel
  std::vector<float> noise_;       // a long stretch of Gaussian noise; empty for none
};

// How far a smear reaches beyond a pixel.
[[nodiscard]] int smearRadius(double length_px);

// The light of each pixel along length_px of its row, evenly and centred: what a knock at the
// camera does while it exposes. The outermost smearRadius() columns are left as they were.
void smearRows(double length_px, Radiance* radiance);

}  // namespace waymark::simulator
