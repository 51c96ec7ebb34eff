// The daemon's messages, as they come in. Goes on trying where there is no network.
#pragma once

#include <memory>
#include <string>

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <lcm/lcm.h>

#include "base/result.h"
#include "view/live_state.h"

namespace waymark::view {

class LcmInput {
 public:
  // All of them must outlive it.
  LcmInput(boost::asio::io_context& io, std::string url, std::string channel_prefix,
           std::string body_channel, LiveState& state);

  void start() { open(); }

 private:
  struct LcmClose {
    void operator()(lcm_t* lcm) const { lcm_destroy(lcm); }
  };

  void open();
  [[nodiscard]] Status subscribeAll();
  void waitForMessages();
  void retry(const std::string& fault);
  template <typename Message>
  [[nodiscard]] bool subscribe(const std::string& channel);

  const std::string url_;
  const std::string prefix_;
  const std::string body_channel_;
  LiveState& state_;
  std::unique_ptr<lcm_t, LcmClose> lcm_;
  boost::asio::posix::stream_descriptor readable_;
  boost::asio::steady_timer pause_;
};

}  // namespace waymark::view
