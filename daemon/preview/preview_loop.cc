#include "daemon/preview/preview_loop.h"

#include <cstddef>
#include <utility>

#include "base/clock.h"

namespace waymark::daemon {

PreviewLoop::PreviewLoop(PreviewLink& frames, const std::string& url, std::string channel,
                         const Log& log, const PreviewOptions& options)
    : frames_(frames), channel_(std::move(channel)), out_(url, log), maker_(options) {}

void PreviewLoop::run() {
  while (const PreviewLink::Query* const frame = frames_.wait()) {
    const bool made = maker_.make(*frame, &message_);
    frames_.done();
    bool sent = false;
    if (made && out_.maintain(monotonicNs())) {
      bytes_.resize(static_cast<std::size_t>(message_.getEncodedSize()));
      message_.encode(bytes_.data(), 0, static_cast<int>(bytes_.size()));
      sent = out_.publish(channel_, bytes_);
    }
    (sent ? sent_ : unsent_).fetch_add(1, std::memory_order_relaxed);
  }
}

void PreviewLoop::reportCounters(const CounterSink& sink) const {
  sink("preview.sent", sent_.load(std::memory_order_relaxed));
  sink("preview.unsent", unsent_.load(std::memory_order_relaxed));
}

}  // namespace waymark::daemon
