#include "tests/subscriber.h"

#include <stdexcept>

namespace waymark::testing {
namespace {

template <typename Message>
void keep(const lcm_recv_buf_t& buffer, std::vector<Message>& into, int& undecodable) {
  Message message;
  if (message.decode(buffer.data, 0, static_cast<int>(buffer.data_size)) < 0) {
    ++undecodable;
  } else {
    into.push_back(std::move(message));
  }
}

}  // namespace

std::vector<pose_t> Received::framePoses() const {
  std::vector<pose_t> of_frames;
  for (const pose_t& pose : poses) {
    if (pose.status != pose_t::STATUS_NO_CAMERA) of_frames.push_back(pose);
  }
  return of_frames;
}

std::map<std::string, std::int64_t> Received::counters() const {
  std::map<std::string, std::int64_t> values;
  if (healths.empty()) return values;
  for (const counter_t& counter : healths.back().counters) values[counter.name] = counter.value;
  return values;
}

Subscriber::Subscriber(const std::string& url, const std::string& prefix)
    : prefix_(prefix), lcm_(lcm_create(url.c_str()), lcm_destroy) {
  if (!lcm_) throw std::runtime_error("no LCM at " + url);
  lcm_subscription_set_queue_capacity(lcm_subscribe(lcm_.get(), ".*", &onMessage, this), 10'000);
  thread_ = std::thread([this] {
    while (!stop_) lcm_handle_timeout(lcm_.get(), 10);
  });
}

Subscriber::~Subscriber() {
  stop_ = true;
  thread_.join();
}

Received Subscriber::received() const {
  const std::lock_guard lock(mutex_);
  return received_;
}

bool Subscriber::waitFor(const std::function<bool(const Received&)>& condition,
                         std::chrono::milliseconds timeout) const {
  const auto until = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      if (condition(received_)) return true;
    }
    if (std::chrono::steady_clock::now() >= until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void Subscriber::onMessage(const lcm_recv_buf_t* buffer, const char* channel, void* self) {
  auto& s = *static_cast<Subscriber*>(self);
  const std::lock_guard lock(s.mutex_);
  Received& r = s.received_;
  const std::string name = channel;
  if (name == s.prefix_ + "POSE") {
    keep(*buffer, r.poses, r.undecodable);
  } else if (name == s.prefix_ + "DETECTIONS") {
    keep(*buffer, r.detections, r.undecodable);
  } else if (name == s.prefix_ + "MAP") {
    keep(*buffer, r.maps, r.undecodable);
  } else if (name == s.prefix_ + "HEALTH") {
    keep(*buffer, r.healths, r.undecodable);
  } else if (name == s.prefix_ + "NATURAL") {
    keep(*buffer, r.natural_detections, r.undecodable);
  } else if (name == s.prefix_ + "NATURAL_MAP") {
    keep(*buffer, r.natural_maps, r.undecodable);
  } else if (name == s.prefix_ + "JOINT") {
    keep(*buffer, r.joints, r.undecodable);
  } else if (name == "POSE") {
    keep(*buffer, r.bot_core_poses, r.undecodable);
  }
}

}  // namespace waymark::testing
