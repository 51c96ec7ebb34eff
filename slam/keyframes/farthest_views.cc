#include "slam/keyframes/farthest_views.h"

#include <algorithm>

namespace waymark::slam {

ViewPositions viewPositions(const Map& map, std::span<const KeyframeId> keyframes,
                            ViewArena* arena) {
  ViewPositions positions(arena->get());
  positions.reserve(keyframes.size() + 1);
  for (const KeyframeId id : keyframes) positions.push_back(map.keyframes().at(id).T_w_c.p);
  return positions;
}

std::pmr::vector<std::size_t> farthestViews(const ViewPositions& views, std::size_t count,
                                            ViewArena* arena) {
  std::pmr::vector<std::size_t> chosen(arena->get());
  if (views.size() <= count) {
    for (std::size_t i = 0; i < views.size(); ++i) chosen.push_back(i);
    return chosen;
  }
  std::size_t first = 0;
  std::size_t second = 1;
  double widest = -1.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const double d = (views[i] - views[j]).squaredNorm();
      if (d > widest) {
        widest = d;
        first = i;
        second = j;
      }
    }
  }
  chosen.assign({first, second});
  std::pmr::vector<double> nearest(views.size(), 0.0,
                                   arena->get());  // squared distance to the nearest chosen view
  for (std::size_t i = 0; i < views.size(); ++i)
    nearest[i] = (views[i] - views[first]).squaredNorm();
  while (chosen.size() < count) {
    for (std::size_t i = 0; i < views.size(); ++i) {
      nearest[i] = std::min(nearest[i], (views[i] - views[chosen.back()]).squaredNorm());
    }
    chosen.push_back(static_cast<std::size_t>(std::max_element(nearest.begin(), nearest.end()) -
                                              nearest.begin()));
  }
  return chosen;
}

}  // namespace waymark::slam
