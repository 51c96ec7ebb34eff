// Which views of a marker are worth keeping (section 4.6).
#pragma once

#include <cstddef>
#include <memory_resource>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "base/stack_arena.h"
#include "slam/map/map.h"

namespace waymark::slam {

using ViewPositions = std::pmr::vector<Eigen::Vector3d>;  // of cameras, metres
using ViewArena = StackArena<8192>;  // for as many views as a marker usually has

// Where these keyframes were taken; with room for one more. Precondition: they exist.
[[nodiscard]] ViewPositions viewPositions(const Map& map, std::span<const KeyframeId> keyframes,
                                          ViewArena* arena);

// Eq. 28: indices (into `views`) of the `count` views that lie farthest from each other: the two
// most separated first, then always the one farthest from those chosen. All where there are no
// more. What is not chosen might as well not be there: the same ones are chosen without it.
[[nodiscard]] std::pmr::vector<std::size_t> farthestViews(const ViewPositions& views,
                                                          std::size_t count, ViewArena* arena);

}  // namespace waymark::slam
