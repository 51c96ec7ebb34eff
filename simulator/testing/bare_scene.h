// A scene with nothing in it but a camera, for tests of the renderer.
#pragma once

#include <string>

#include "simulator/scene.h"

namespace waymark::simulator::testing {

// 320x240 pixels, without distortion.
inline Scene bareScene(const std::string& name) {
  return {.name = name,
          .dictionary = *slam::Dictionary::byName("4X4_50"),
          .camera = {.width = 320, .height = 240, .fx = 250, .fy = 250, .cx = 160, .cy = 118},
          .surfaces = {},
          .markers = {},
          .prints = {},
          .trajectory = {}};
}

}  // namespace waymark::simulator::testing
