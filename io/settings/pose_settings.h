// Poses in settings files: a position and an orientation, each a key.
#pragma once

#include <string>

#include "io/settings/settings_file.h"
#include "slam/geometry/transform.h"

namespace waymark::io {

// [x, y, z], metres, into target.p.
[[nodiscard]] Setting positionSetting(std::string key, slam::Transform& target);

// A unit quaternion [w, x, y, z] into target.R; one that somebody rounded will do.
[[nodiscard]] Setting orientationSetting(std::string key, slam::Transform& target);

}  // namespace waymark::io
