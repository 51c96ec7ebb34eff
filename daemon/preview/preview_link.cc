#include "daemon/preview/preview_link.h"

#include <algorithm>

namespace waymark::daemon {

PreviewLink::PreviewLink(int width, int height)
    : pixels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  query_.image = {pixels_.data(), width, height, width};
}

void PreviewLink::ask(std::int64_t now_ns) {
  asked_until_ns_.store(now_ns + kLease_ns, std::memory_order_relaxed);
}

bool PreviewLink::wanted(std::int64_t now_ns) const {
  return now_ns < asked_until_ns_.load(std::memory_order_relaxed) && now_ns >= next_ns_ &&
         !taken_.load(std::memory_order_acquire);
}

void PreviewLink::give(const capture::FrameStamp& stamp, const ImageView& image,
                       std::span<const slam::MarkerDetection> markers, std::int64_t now_ns) {
  if (image.width != query_.image.width || image.height != query_.image.height) return;
  for (int y = 0; y < image.height; ++y) {
    std::copy_n(image.row(y), image.width,
                pixels_.data() + static_cast<std::ptrdiff_t>(y) * image.width);
  }
  query_.stamp = stamp;
  query_.seen = std::min(markers.size(), kMostSeen);
  for (std::size_t i = 0; i < query_.seen; ++i) query_.markers[i] = markers[i].pixels;
  next_ns_ = now_ns + kInterval_ns;
  taken_.store(true, std::memory_order_release);
  wake_.release();
}

const PreviewLink::Query* PreviewLink::wait() {
  wake_.acquire();
  return stop_.load(std::memory_order_relaxed) ? nullptr : &query_;
}

void PreviewLink::requestStop() {
  stop_.store(true, std::memory_order_relaxed);
  wake_.release();
}

}  // namespace waymark::daemon
