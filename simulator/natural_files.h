// What users would have of a scene's natural markers: their pictures and files that name them; and
// the targets, for whoever measures.
#pragma once

#include <filesystem>

#include "base/result.h"
#include "simulator/scene.h"

namespace waymark::simulator {

// natural.json with all pictures, natural_NAME.json with each that hangs in the scene and those
// that hang nowhere (seed 2, section 4.2.2), natural/*.png; gt_targets.json:
// {"note","targets":[{"name","p":[x,y,z]}]}, metres in the frame of gt_traj.txt. Nothing where the
// scene has none. The Error names the file and the reason.
[[nodiscard]] Status writeNatural(const std::filesystem::path& directory, const Scene& scene);

// Takes away what writeNatural() wrote; what is not there is no fault.
void removeNatural(const std::filesystem::path& directory, const Scene& scene);

}  // namespace waymark::simulator
