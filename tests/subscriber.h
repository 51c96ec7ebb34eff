// Collects everything a waymarkd publishes, on a thread of its own.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <bot_core/pose_t.hpp>
#include <lcm/lcm.h>

#include <waymark/detections_t.hpp>
#include <waymark/health_t.hpp>
#include <waymark/joint_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/natural_detections_t.hpp>
#include <waymark/natural_map_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::testing {

struct Received {
  std::vector<pose_t> poses;
  std::vector<bot_core::pose_t> bot_core_poses;
  std::vector<detections_t> detections;
  std::vector<map_t> maps;
  std::vector<health_t> healths;
  std::vector<natural_detections_t> natural_detections;
  std::vector<natural_map_t> natural_maps;
  std::vector<joint_t> joints;
  int undecodable = 0;

  // Poses that frames stand behind.
  [[nodiscard]] std::vector<pose_t> framePoses() const;
  // The counters of the last health message.
  [[nodiscard]] std::map<std::string, std::int64_t> counters() const;
};

class Subscriber {
 public:
  // Listens when the constructor returns, in the caller's network namespace.
  Subscriber(const std::string& url, const std::string& prefix);
  Subscriber(const Subscriber&) = delete;
  Subscriber& operator=(const Subscriber&) = delete;
  ~Subscriber();

  [[nodiscard]] Received received() const;
  // Waits until it holds; false when it does not within `timeout`.
  bool waitFor(const std::function<bool(const Received&)>& condition,
               std::chrono::milliseconds timeout) const;

 private:
  static void onMessage(const lcm_recv_buf_t* buffer, const char* channel, void* self);

  const std::string prefix_;
  const std::unique_ptr<lcm_t, void (*)(lcm_t*)> lcm_;
  mutable std::mutex mutex_;
  Received received_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace waymark::testing
