// What the page asks of the daemon, through its control socket, on a thread of its own: an answer
// may take seconds, and the page is served meanwhile.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>

#include "base/result.h"
#include "io/text/json_node.h"
#include "view/live_state.h"

namespace waymark::view {

// The request that a command of the page stands for: {"command":"save-map"}, "load-map" (the one
// that the daemon starts with), "reset", "record-start" or "record-stop". An error says what is
// wrong with any other.
[[nodiscard]] Result<io::Json> requestOf(const std::string& command);

class ControlLink {
 public:
  // socket: empty: where daemons usually listen. The others must outlive it.
  ControlLink(boost::asio::io_context& io, std::filesystem::path socket, LiveState& state);
  ~ControlLink();
  ControlLink(const ControlLink&) = delete;
  ControlLink& operator=(const ControlLink&) = delete;

  // Whether somebody looks, who would like to see images. Before start().
  void setLookedAt(std::function<bool()> looked_at) { looked_at_ = std::move(looked_at); }

  // Asks for the status now, and every second.
  void start() { askStatus(); }

  // `answer` gets {"type":"answer", "ok", "result" or "error"}.
  void command(const std::string& text, std::function<void(std::string)> answer);

 private:
  void askStatus();
  [[nodiscard]] Result<io::Json> ask(const io::Json& request, int timeout_s) const;

  boost::asio::io_context& io_;
  const std::filesystem::path socket_;
  LiveState& state_;
  std::function<bool()> looked_at_;
  boost::asio::steady_timer pause_;
  boost::asio::thread_pool asker_{1};
};

}  // namespace waymark::view
