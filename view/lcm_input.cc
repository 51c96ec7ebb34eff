#include "view/lcm_input.h"

#include <chrono>
#include <utility>

#include <unistd.h>

#include "base/clock.h"
#include "daemon/publish/lcm_link.h"
#include "view/decode_message.h"

namespace waymark::view {

LcmInput::LcmInput(boost::asio::io_context& io, std::string url, std::string channel_prefix,
                   std::string body_channel, LiveState& state)
    : url_(std::move(url)),
      prefix_(std::move(channel_prefix)),
      body_channel_(std::move(body_channel)),
      state_(state),
      readable_(io),
      pause_(io) {}

void LcmInput::open() {
  const auto address = daemon::multicastAddress(url_);
  if (!address || !daemon::hasRoute(*address)) return retry(url_ + ": there is no multicast route");
  lcm_.reset(lcm_create(url_.c_str()));
  if (!lcm_) return retry(url_ + ": LCM refuses it");
  if (const Status subscribed = subscribeAll(); !subscribed) {
    lcm_.reset();
    return retry(subscribed.error().message);
  }
  state_.setFault("");
  // Its own copy, which it may close.
  readable_.assign(::dup(lcm_get_fileno(lcm_.get())));
  waitForMessages();
}

void LcmInput::retry(const std::string& fault) {
  state_.setFault(fault);
  pause_.expires_after(std::chrono::seconds(2));
  pause_.async_wait([this](const boost::system::error_code& stopped) {
    if (!stopped) open();
  });
}

template <typename Message>
bool LcmInput::subscribe(const std::string& channel) {
  const auto receive = [](const lcm_recv_buf_t* buffer, const char*, void* self) {
    addDecoded<Message>(buffer->data, buffer->data_size, monotonicNs(),
                        &static_cast<LcmInput*>(self)->state_);
  };
  lcm_subscription_t* subscription = lcm_subscribe(lcm_.get(), channel.c_str(), receive, this);
  if (subscription == nullptr) return false;
  lcm_subscription_set_queue_capacity(subscription, 300);
  return true;
}

Status LcmInput::subscribeAll() {
  const bool all = subscribe<pose_t>(prefix_ + "POSE") && subscribe<map_t>(prefix_ + "MAP") &&
                   subscribe<health_t>(prefix_ + "HEALTH") &&
                   subscribe<detections_t>(prefix_ + "DETECTIONS") &&
                   subscribe<natural_map_t>(prefix_ + "NATURAL_MAP") &&
                   subscribe<natural_detections_t>(prefix_ + "NATURAL") &&
                   subscribe<preview_t>(prefix_ + "PREVIEW") &&
                   subscribe<calibration_t>(prefix_ + "CALIBRATION") &&
                   subscribe<bot_core::pose_t>(body_channel_);
  if (!all) return Error{prefix_ + "...: cannot subscribe"};
  return success();
}

void LcmInput::waitForMessages() {
  using Descriptor = boost::asio::posix::stream_descriptor;
  readable_.async_wait(Descriptor::wait_read, [this](const boost::system::error_code& stopped) {
    if (stopped) return;
    // A bounded number, so that pages get their turn whatever comes in.
    constexpr int kMost = 100;
    for (int i = 0; i < kMost; ++i) {
      const int handled = lcm_handle_timeout(lcm_.get(), 0);
      if (handled == 0) break;
      if (handled > 0) continue;
      readable_.close();
      lcm_.reset();
      return retry(url_ + ": receiving failed");
    }
    waitForMessages();
  });
}

}  // namespace waymark::view
