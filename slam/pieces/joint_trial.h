// A joint of two pieces that was made and may yet prove wrong: the two as they were, what they were
// joined by, and what later frames say of it. These are compared with the pieces as they were, as
// the joined map has followed what it believes.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "slam/map/map.h"
#include "slam/pieces/piece_joint.h"

namespace waymark::slam {

class JointTrial {
 public:
  enum class Verdict { kOpen, kBelieved, kRefuted };

  // `into` took in `from`.
  JointTrial(Map into, Map from, const PieceJoint& joint)
      : into_(std::move(into)), from_(std::move(from)), joint_(joint) {}

  // A frame seen in the joined piece. What shows markers of one of the two only says nothing. As
  // long as a single marker of either is all that connects them, they are never believed: it may be
  // another print of its id.
  Verdict watch(std::span<const MarkerDetection> detections, std::int64_t time_ns,
                const JointParts& parts);

  [[nodiscard]] int into() const { return into_.piece; }
  [[nodiscard]] int from() const { return from_.piece; }
  [[nodiscard]] const PieceJoint& joint() const { return joint_; }
  // The pieces as they were; once.
  [[nodiscard]] Map takeInto() { return std::move(into_); }
  [[nodiscard]] Map takeFrom() { return std::move(from_); }
  // All that agreed rests on this marker: it hangs twice, where the joint is refuted.
  [[nodiscard]] std::optional<int> onlyMarker() const {
    if (seen_into_.size() == 1) return *seen_into_.begin();
    if (seen_from_.size() == 1) return *seen_from_.begin();
    return std::nullopt;
  }
  // What contradicts, for whoever thinks of joining them again.
  [[nodiscard]] const std::vector<JointView>& against() const { return against_; }

 private:
  Map into_;
  Map from_;
  PieceJoint joint_;
  int frames_ = 0;           // that contradict, or agree by more than one marker of each
  std::set<int> seen_into_;  // the markers that frames which agree rest on
  std::set<int> seen_from_;
  std::int64_t last_ns_ = 0;
  std::vector<JointView> against_;
};

}  // namespace waymark::slam
