#include "daemon/natural/relocalizer_link.h"

#include <algorithm>
#include <utility>

#include "io/text/json_node.h"

namespace waymark::daemon {

RelocalizerLink::RelocalizerLink(std::vector<int> ids, int width, int height)
    : ids_(std::move(ids)),
      pixels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  query_.frame.image = {pixels_.data(), width, height, width};
  query_.T_w_m.resize(ids_.size());
}

std::span<const slam::LateResult> RelocalizerLink::hear() {
  if (turn_.load(std::memory_order_acquire) != Turn::kSlam) return {};
  turn_.store(Turn::kNobody, std::memory_order_relaxed);
  if (query_.frame.generation != generation_) return {};
  return std::span(results_).first(count_);
}

bool RelocalizerLink::idle() const {
  return turn_.load(std::memory_order_relaxed) == Turn::kNobody &&
         !resting_.load(std::memory_order_relaxed);
}

void RelocalizerLink::ask(const slam::FrameInput& frame, const slam::FrameResult& result,
                          const slam::CameraModel& camera, const slam::Map& map,
                          std::uint64_t map_revision) {
  const ImageView& image = *frame.image;
  for (int y = 0; y < image.height; ++y) {
    std::copy_n(image.row(y), image.width,
                pixels_.data() + static_cast<std::ptrdiff_t>(y) * image.width);
  }
  query_.frame.time = frame.time;
  query_.frame.generation = generation_;
  query_.camera = camera;
  query_.frame.last.reset();
  if (result.pose) {
    query_.frame.last = {result.pose->T_w_c, result.pose->covariance.topLeftCorner<3, 3>()};
  }
  followMap(map, map_revision);
  turn_.store(Turn::kOther, std::memory_order_release);
  wake_.release();
}

void RelocalizerLink::followMap(const slam::Map& map, std::uint64_t revision) {
  if (revision == map_revision_) return;
  map_revision_ = revision;
  for (std::size_t i = 0; i < ids_.size(); ++i) {
    const slam::MapMarker* const known = map.findPosed(ids_[i]);
    query_.T_w_m[i] = known == nullptr ? std::nullopt : known->T_w_m;
  }
}

const RelocalizerLink::Query* RelocalizerLink::wait() {
  resting_.store(false, std::memory_order_relaxed);
  if (stopped()) return nullptr;
  wake_.acquire();
  return stopped() ? nullptr : &query_;
}

void RelocalizerLink::answer(std::span<const slam::LateResult> results) {
  count_ = std::min(results.size(), kMostResults);
  left_out_.fetch_add(results.size() - count_, std::memory_order_relaxed);
  std::copy_n(results.begin(), count_, results_.begin());
  for (slam::LateResult& result : results_) {
    result.T_m_c = io::asRead(result.T_m_c);
    if (result.other) result.other->T_m_c = io::asRead(result.other->T_m_c);
  }
  resting_.store(true, std::memory_order_relaxed);  // until wait()
  turn_.store(Turn::kSlam, std::memory_order_release);
}

void RelocalizerLink::rest(std::chrono::nanoseconds time) {
  (void)wake_.try_acquire_for(time);  // nobody asks meanwhile: it is a stop
}

void RelocalizerLink::requestStop() {
  stop_.store(true, std::memory_order_relaxed);
  wake_.release();
}

}  // namespace waymark::daemon
