// What others want of the SLAM itself (a copy of its map, another SLAM in its place) happens on its
// own thread, between two frames: one request at a time, looked for whenever the loop comes round.
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "daemon/frames/capture_loop.h"
#include "slam/slam.h"

namespace waymark::daemon {

class SlamRequests {
 public:
  // Runs on the SLAM thread, which meanwhile does nothing else: no more than a frame's worth of
  // work. It may put another SLAM in the place of this one, but not none.
  using Request = std::function<void(std::unique_ptr<slam::Slam>& slam)>;

  explicit SlamRequests(FrameQueue& frames) : frames_(frames) {}

  // One other thread: waits until the request is done. False when the SLAM loop has ended; then it
  // was not done.
  [[nodiscard]] bool run(const Request& request) {
    outcome_.store(Outcome::kOpen, std::memory_order_relaxed);
    const Request* expected = nullptr;
    if (!request_.compare_exchange_strong(expected, &request, std::memory_order_acq_rel)) {
      return false;
    }
    frames_.wake();
    outcome_.wait(Outcome::kOpen, std::memory_order_acquire);
    return outcome_.load(std::memory_order_acquire) == Outcome::kDone;
  }

  // SLAM thread: is there one? All that a frame has to pay for requests.
  [[nodiscard]] bool pending() const { return request_.load(std::memory_order_relaxed) != nullptr; }
  // SLAM thread, when there is one.
  void serve(std::unique_ptr<slam::Slam>& slam) {
    (*request_.load(std::memory_order_acquire))(slam);
    request_.store(nullptr, std::memory_order_release);
    finish(Outcome::kDone);
  }
  // SLAM thread: no request will be run any more.
  void close() {
    if (request_.exchange(&closed_, std::memory_order_acq_rel) != nullptr) {
      finish(Outcome::kRejected);
    }
  }

 private:
  enum class Outcome : int { kOpen, kDone, kRejected };

  void finish(Outcome outcome) {
    outcome_.store(outcome, std::memory_order_release);
    outcome_.notify_one();
  }

  FrameQueue& frames_;
  const Request closed_;  // stands in the request's place when there will be none any more
  std::atomic<const Request*> request_{nullptr};
  std::atomic<Outcome> outcome_{Outcome::kOpen};
};

}  // namespace waymark::daemon
