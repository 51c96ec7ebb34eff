// What the inside of a building looks like, as images that cover surfaces: large plain areas, and
// on them what there always is. Lengths in metres; grey levels as they reach the sensor.
#pragma once

#include <memory>
#include <vector>

#include "simulator/printed_image.h"
#include "simulator/random.h"

namespace waymark::simulator {

using SharedImage = std::shared_ptr<const PrintedImage>;

struct WallLook {
  double width_m = 0.0;
  double height_m = 0.0;
  double grey = 175.0;
  // The lower metre is painted darker, as in corridors and staircases.
  bool dado = false;
  // Middles of doors, and of windows, from the wall's left end as one looks at it.
  std::vector<double> doors_m{};
  std::vector<double> windows_m{};
};

// Plaster with skirting, doors with frames and plates, switches and sockets, ducts and scuffs.
[[nodiscard]] SharedImage wallImage(const WallLook& look, Random* random);

// Linoleum in sheets, with stains, scratches and dirt along the walls.
[[nodiscard]] SharedImage floorImage(double width_m, double height_m, Random* random);

// Panels of 0.6 m, some of them lamps, vents or stained.
[[nodiscard]] SharedImage ceilingImage(double width_m, double height_m, Random* random);

// Shelves full of files and books.
[[nodiscard]] SharedImage shelfImage(double width_m, double height_m, Random* random);

// Cork, wood or cloth: uneven, of about this grey level.
[[nodiscard]] SharedImage materialImage(double width_m, double height_m, double grey,
                                        double contrast, Random* random);

}  // namespace waymark::simulator
