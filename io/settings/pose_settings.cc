#include "io/settings/pose_settings.h"

#include <cmath>
#include <utility>

#include <Eigen/Geometry>

#include "io/text/plausible.h"

namespace waymark::io {
namespace {

// The length of a quaternion somebody rounded to three decimals may be this far from 1.
constexpr double kOffUnit = 1e-2;

}  // namespace

Setting positionSetting(std::string key, slam::Transform& target) {
  return numbersSetting(std::move(key), 3, [&target](std::span<const double> p) -> ValidationError {
    const Eigen::Vector3d position(p[0], p[1], p[2]);
    if (!isPosition(position)) return kPositions;
    target.p = position;
    return {};
  });
}

Setting orientationSetting(std::string key, slam::Transform& target) {
  return numbersSetting(std::move(key), 4,
                        [&target](std::span<const double> wxyz) -> ValidationError {
                          const Eigen::Quaterniond q(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
                          if (!(std::abs(q.norm() - 1.0) < kOffUnit)) return "must have length 1";
                          target.R = q.normalized().toRotationMatrix();
                          return {};
                        });
}

}  // namespace waymark::io
