#include "tools/natural/delayed_relocalizer.h"

#include <optional>
#include <utility>

namespace waymark::tools {

slam::FrameInput DelayedRelocalizer::prepare(slam::FrameInput frame, const slam::Slam& /*slam*/) {
  delivered_.clear();
  if (due_in_ > 0 && --due_in_ == 0) std::swap(delivered_, found_);
  frame.late = delivered_;
  frame.awaited = due_in_ == 0 && frame.image.has_value();
  return frame;
}

void DelayedRelocalizer::look(const slam::FrameInput& frame, const slam::FrameResult& result,
                              const slam::Slam& slam) {
  if (!frame.awaited) return;
  for (std::size_t i = 0; i < relocalizer_.size(); ++i) {
    const slam::MapMarker* const known = slam.map().findPosed(relocalizer_.ids()[i]);
    relocalizer_.setPose(static_cast<int>(i), known == nullptr ? std::nullopt : known->T_w_m);
  }
  slam::RelocalizationQuery query{
      .time = frame.time, .generation = 0, .image = *frame.image, .last = {}};
  if (result.pose) {
    query.last = {result.pose->T_w_c, result.pose->covariance.topLeftCorner<3, 3>()};
  }
  const auto found = relocalizer_.locate(query, slam.camera());
  found_.assign(found.begin(), found.end());
  due_in_ = delay_frames_;
}

}  // namespace waymark::tools
