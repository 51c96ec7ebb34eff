#include "slam/covariance/world_covariance.h"

#include <algorithm>
#include <memory_resource>
#include <tuple>
#include <vector>

#include "base/stack_arena.h"
#include "slam/covariance/marker_information.h"
#include "slam/geometry/minimize_pose.h"

namespace waymark::slam {
namespace {

// One marker's say in the pose.
struct Voice {
  const KnownMarker* marker = nullptr;
  Matrix6d gain;  // G = T^T A: what its error adds to the right side of the normal equations
  double information = 0.0;
  bool of_map = false;  // its place, and what it has in common with the leader's, is known
};

using Voices = std::pmr::vector<Voice>;

int idOf(const Voice& voice) { return voice.marker->detection->id; }

// sum_ij G_i E[delta_i delta_j^T] G_j^T of markers whose common covariances are all known, those
// that say most first: blocks of one positive matrix. The others hang on the first of them. Empty
// where the marginals know none. Precondition: sorted by what they say.
std::optional<Matrix6d> spreadOfMap(Voices* voices, const MapMarginals& marginals) {
  Voice* leader = nullptr;
  Matrix6d spread = Matrix6d::Zero();
  for (Voice& voice : *voices) {
    const bool known = marginals.find(idOf(voice)) != nullptr;
    voice.of_map =
        known && std::ranges::all_of(*voices, [&](const Voice& other) {
          return !other.of_map || marginals.findBetween(idOf(voice), idOf(other)) != nullptr;
        });
    if (voice.of_map && leader == nullptr) leader = &voice;
  }
  if (leader == nullptr) return std::nullopt;
  for (const Voice& voice : *voices) {
    if (voice.of_map) continue;
    leader->gain += voice.gain * rigidTransport(voice.marker->T_w_m.p - leader->marker->T_w_m.p);
  }
  Matrix6d half;
  Matrix6d shared;
  for (std::size_t i = 0; i < voices->size(); ++i) {
    const Voice& a = (*voices)[i];
    if (!a.of_map) continue;
    half.noalias() = a.gain * *marginals.find(idOf(a));
    spread.noalias() += half * a.gain.transpose();
    for (std::size_t j = 0; j < i; ++j) {
      const Voice& b = (*voices)[j];
      if (!b.of_map) continue;
      const auto& [small, large] = idOf(a) < idOf(b) ? std::tie(a, b) : std::tie(b, a);
      half.noalias() = small.gain * *marginals.findBetween(idOf(a), idOf(b));
      shared.noalias() = half * large.gain.transpose();
      spread += shared + shared.transpose();
    }
  }
  return spread;
}

}  // namespace

std::optional<WorldCovariance> worldCovariance(const PoseSolution& solution,
                                               std::span<const KnownMarker> markers,
                                               const MapMarginals& marginals,
                                               const PlaceDoubt& otherwise) {
  StackArena<16384> arena;
  Voices voices(arena.get());
  voices.reserve(markers.size());
  Matrix6d H = Matrix6d::Zero();
  Matrix6d noise = Matrix6d::Zero();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    const KnownMarker& marker = markers[i];
    const auto information = markerInformation(marker.T_w_m, marker.size_m, *marker.detection,
                                               solution.T_w_c, marker.covariance);
    if (!information) continue;
    const Matrix6d T = rigidTransport(marker.T_w_m.p - solution.T_w_c.p);
    Voice& voice = voices.emplace_back();
    voice.marker = &marker;
    voice.gain.noalias() = T.transpose() * information->weighted;
    voice.information = information->weighted.topLeftCorner<3, 3>().trace();
    H.noalias() += voice.gain * T;
    noise.noalias() += T.transpose() * information->noise * T;
  }
  const auto H_inverse = inverseOf(H);
  if (!H_inverse) return std::nullopt;
  noise *= solution.residual_variance;

  WorldCovariance result;
  const auto atCamera = [&](const Matrix6d& spread) {
    return Matrix6d(*H_inverse * spread * *H_inverse);
  };
  std::ranges::sort(voices, std::ranges::greater{}, &Voice::information);
  if (const auto spread = spreadOfMap(&voices, marginals)) {
    result.doubt = PlaceDoubt{solution.T_w_c.p, atCamera(*spread)};
    result.covariance = result.doubt->covariance;
  } else {
    const Matrix6d T = rigidTransport(solution.T_w_c.p - otherwise.p_w);
    result.covariance = T * otherwise.covariance * T.transpose();
  }
  for (const Voice& voice : voices) {
    if (!voice.of_map)
      noise.noalias() += voice.gain * voice.marker->covariance * voice.gain.transpose();
  }
  result.covariance += atCamera(noise);
  return result;
}

}  // namespace waymark::slam
