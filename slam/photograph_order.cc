#include "slam/photograph_order.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <utility>

#include "slam/geometry/polygon.h"

namespace waymark::slam {
namespace {

// How much of these a frame shows: the sum of their sides in the image. One marker alone leaves two
// poses, and is worth little.
double shows(const LiveFrame& frame, const std::set<int>& markers) {
  constexpr double kAlone = 0.1;
  double sides = 0.0;
  int count = 0;
  for (const MarkerDetection& detection : frame.detections) {
    if (!markers.contains(detection.id)) continue;
    sides += meanSide(detection.pixels);
    ++count;
  }
  return count == 1 ? kAlone * sides : sides;
}

class PhotographOrder {
 public:
  PhotographOrder(std::span<const LiveFrame> frames, Slam* slam)
      : frames_(frames), slam_(slam), placed_(frames.size()), given_with_(frames.size(), kNever) {
    std::map<int, int> views;
    for (const LiveFrame& frame : frames) {
      for (const MarkerDetection& detection : frame.detections) ++views[detection.id];
    }
    for (const auto& [id, count] : views) {
      if (count > 1) shared_.insert(id);
    }
  }

  std::vector<Placement> placeAll() {
    while (const auto next = choose()) give(*next);
    // What is left shows too little for a pose, or nothing.
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (given_with_[i] == kNever) give({i, 0.0});
    }
    return std::move(placed_);
  }

 private:
  static constexpr double kNever = -1.0;  // below what any frame shows

  struct Choice {
    std::size_t frame = 0;
    double shows = 0.0;
  };

  // The frame that shows most of what is known, and more of it than when it was given before; if
  // there is none, the one that is best to begin from.
  [[nodiscard]] std::optional<Choice> choose() const {
    std::optional<Choice> best;
    for (const std::set<int>* const markers : {&known_, &shared_}) {
      for (std::size_t i = 0; i < frames_.size(); ++i) {
        if (placed_[i].pose || (markers == &shared_ && given_with_[i] != kNever)) continue;
        const double of_these = shows(frames_[i], *markers);
        if (of_these <= std::max(given_with_[i], 0.0)) continue;
        if (!best || of_these > best->shows) best = {i, of_these};
      }
      if (best) return best;
    }
    return std::nullopt;
  }

  void give(const Choice& choice) {
    const LiveFrame& frame = frames_[choice.frame];
    given_with_[choice.frame] = choice.shows;
    const FrameResult result = slam_->process({.time = {choice.frame, frame.monotonic_ns},
                                               .detections = frame.detections,
                                               .found = frame.found});
    placed_[choice.frame] = {result.state, result.reason, result.pose};
    note(frame);
  }

  // What is in the map; and as long as that is empty, what was seen so far: the pair that it begins
  // from shows the same.
  void note(const LiveFrame& frame) {
    std::set<int> in_map;
    for (const Map* const piece : slam_->pieces()) {
      for (const auto& [id, marker] : piece->markers()) {
        if (marker.T_w_m) in_map.insert(id);
      }
    }
    if (!in_map.empty()) {
      known_ = std::move(in_map);
      return;
    }
    for (const MarkerDetection& detection : frame.detections) known_.insert(detection.id);
  }

  std::span<const LiveFrame> frames_;
  Slam* slam_;
  std::vector<Placement> placed_;
  std::vector<double> given_with_;  // how much of what was known then each showed
  std::set<int> known_;
  std::set<int> shared_;  // markers that several frames show
};

}  // namespace

std::vector<Placement> placeInOrder(std::span<const LiveFrame> frames, Slam* slam) {
  slam->beginAnew();
  return PhotographOrder(frames, slam).placeAll();
}

}  // namespace waymark::slam
