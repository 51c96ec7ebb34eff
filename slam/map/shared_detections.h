// What a keyframe sees, shared between copies of the map: a copy costs a pointer, not the corners.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "slam/detection/marker_detection.h"

namespace waymark::slam {

// Detections that never change, only ever replaced by others: copies may be read, and let go, by
// other threads.
class SharedDetections {
 public:
  using value_type = MarkerDetection;
  using const_iterator = std::vector<MarkerDetection>::const_iterator;

  SharedDetections() = default;
  SharedDetections(std::vector<MarkerDetection> detections)  // NOLINT(google-explicit-constructor)
      : detections_(detections.empty() ? nullptr
                                       : std::make_shared<const std::vector<MarkerDetection>>(
                                             std::move(detections))) {}
  SharedDetections(std::initializer_list<MarkerDetection> detections)
      : SharedDetections(std::vector<MarkerDetection>(detections)) {}
  template <std::input_iterator It>
  SharedDetections(It first, It last)
      : SharedDetections(std::vector<MarkerDetection>(first, last)) {}

  [[nodiscard]] const std::vector<MarkerDetection>& get() const {
    static const std::vector<MarkerDetection> kNone;
    return detections_ ? *detections_ : kNone;
  }
  [[nodiscard]] const_iterator begin() const { return get().begin(); }
  [[nodiscard]] const_iterator end() const { return get().end(); }
  [[nodiscard]] const MarkerDetection* data() const { return get().data(); }
  [[nodiscard]] std::size_t size() const { return get().size(); }
  [[nodiscard]] bool empty() const { return get().empty(); }
  [[nodiscard]] const MarkerDetection& operator[](std::size_t i) const { return get()[i]; }
  [[nodiscard]] const MarkerDetection& front() const { return get().front(); }
  [[nodiscard]] const MarkerDetection& back() const { return get().back(); }

  // Others in their place: change(&vector) is given a copy of them.
  template <typename Change>
  void change(const Change& change) {
    std::vector<MarkerDetection> detections = get();
    change(&detections);
    *this = SharedDetections(std::move(detections));
  }
  void push_back(const MarkerDetection& detection) {
    change([&](auto* detections) { detections->push_back(detection); });
  }

 private:
  std::shared_ptr<const std::vector<MarkerDetection>> detections_;  // null: none
};

}  // namespace waymark::slam
