#include "slam/natural/pictures/nearby_pictures.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "slam/option_checks.h"

namespace waymark::slam {

std::string NearbyPicturesOptions::invalidReason() const {
  return firstUnmet({
      {most >= 1, "at least 1 picture must be looked for"},
      {isNotNegative(sigmas), "the sigmas of the last place must not be negative"},
  });
}

std::vector<int> nearbyPictures(std::span<const std::optional<Transform>> T_w_m,
                                const std::optional<Transform>& T_w_c,
                                const Eigen::Matrix3d& position_covariance,
                                const NearbyPicturesOptions& options) {
  if (!T_w_c || !position_covariance.allFinite()) return {};
  std::vector<double> distances;
  for (const auto& T : T_w_m) {
    if (T) distances.push_back((T->p - T_w_c->p).norm());
  }
  const auto most = static_cast<std::size_t>(options.most);
  if (distances.size() <= most) return {};
  const auto last = distances.begin() + static_cast<std::ptrdiff_t>(most - 1);
  std::nth_element(distances.begin(), last, distances.end());
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(position_covariance, Eigen::EigenvaluesOnly);
  const double off_m = options.sigmas * std::sqrt(std::max(0.0, eigen.eigenvalues().maxCoeff()));
  // One that is farther by less than twice what the camera may be off could be the nearer one.
  const double farthest_m = *last + 2.0 * off_m;
  std::vector<int> nearby;
  for (std::size_t i = 0; i < T_w_m.size(); ++i) {
    if (!T_w_m[i] || !((T_w_m[i]->p - T_w_c->p).norm() > farthest_m)) {
      nearby.push_back(static_cast<int>(i));
    }
  }
  if (nearby.size() == T_w_m.size()) return {};
  return nearby;
}

}  // namespace waymark::slam
