#include "tools/maps/live_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include <Eigen/Geometry>

#include "slam/map/map.h"

namespace waymark::tools {
namespace {

// Anybody can send on a channel, so what comes is checked before it is used.
std::optional<slam::Transform> placeOf(const double (&p_w_m)[3], const double (&q_w_m)[4]) {
  const Eigen::Quaterniond q(q_w_m[0], q_w_m[1], q_w_m[2], q_w_m[3]);
  const Eigen::Vector3d p(p_w_m[0], p_w_m[1], p_w_m[2]);
  constexpr double kOffUnit = 1e-3;
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) < kOffUnit)) return std::nullopt;
  return slam::Transform::fromQuaternion(q, p);
}

bool isLength(double m) { return m > 0.0 && std::isfinite(m); }

std::optional<io::MarkerCorners> cornersOf(const marker_t& m) {
  const auto T_w_m = placeOf(m.p_w_m, m.q_w_m);
  if (m.id < 0 || !isLength(m.size) || !T_w_m) return std::nullopt;
  io::MarkerCorners marker{m.id, m.size, slam::markerCorners(m.size)};
  for (Eigen::Vector3d& corner : marker.corners) corner = *T_w_m * corner;
  return marker;
}

// One whose print the daemon was not told of comes without a height: a square, then.
std::optional<io::NaturalMarkerCorners> cornersOf(const natural_marker_t& m) {
  const double height_m = m.height == 0.0 ? m.width : m.height;
  const auto T_w_m = placeOf(m.p_w_m, m.q_w_m);
  if (!isLength(m.width) || !isLength(height_m) || !T_w_m) return std::nullopt;
  return io::NaturalMarkerCorners{m.name, io::rectangleCorners(*T_w_m, m.width, height_m)};
}

template <typename Message>
bool isSound(const Message& part) {
  return std::ranges::all_of(part.markers,
                             [](const auto& marker) { return cornersOf(marker).has_value(); });
}

// Those in one piece of the map, of all parts, which are sound.
template <typename Corners, typename Message>
std::vector<Corners> inPiece(const io::MapParts<Message>& parts, int map_piece) {
  std::vector<Corners> found;
  for (const auto& [number, part] : parts.whole()) {
    for (const auto& marker : part.markers) {
      if (marker.map_piece == map_piece) found.push_back(*cornersOf(marker));
    }
  }
  return found;
}

template <typename Message>
void addPieces(const io::MapParts<Message>& parts, std::set<int>* pieces) {
  for (const auto& [number, part] : parts.whole()) {
    for (const auto& marker : part.markers) pieces->insert(marker.map_piece);
  }
}

}  // namespace

bool LiveMap::add(const map_t& part) {
  return isSound(part) && map_.add(part) != io::PartAdded::kImpossible;
}

bool LiveMap::add(const natural_map_t& part) {
  return isSound(part) && natural_.add(part) != io::PartAdded::kImpossible;
}

std::vector<io::MarkerCorners> LiveMap::markers(int map_piece) const {
  auto found = inPiece<io::MarkerCorners>(map_, map_piece);
  std::ranges::sort(found, {}, &io::MarkerCorners::id);
  return found;
}

std::vector<io::NaturalMarkerCorners> LiveMap::natural(int map_piece) const {
  return inPiece<io::NaturalMarkerCorners>(natural_, map_piece);
}

std::vector<int> LiveMap::worlds() const {
  std::set<int> pieces;
  addPieces(map_, &pieces);
  addPieces(natural_, &pieces);
  return {pieces.begin(), pieces.end()};
}

}  // namespace waymark::tools
