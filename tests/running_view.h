// waymark-view, and what asks it for something. Tests only.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include "tests/process.h"
#include "tests/running_daemon.h"

namespace waymark::testing {

class ViewTest : public RunningDaemonTest {
 protected:
  // Starts it, and waits until it says where.
  void view(std::vector<std::string> options = {}) {
    options.insert(options.begin(),
                   {WAYMARK_VIEW, "--port", std::to_string(port_), "--url", url_,
                    "--channel-prefix", "TEST_", "--page", WAYMARK_VIEW_PAGE, "--health",
                    WAYMARK_HEALTH_MD, "--socket", (directory_ / "control.sock").string()});
    view_ = std::make_unique<Process>(options, directory_ / "view.err", directory_ / "view.out");
    ASSERT_TRUE(eventually([&] {
      return readFile(directory_ / "view.out").find('\n') != std::string::npos;
    })) << view_->stderrText();
    const std::string said = readFile(directory_ / "view.out");
    port_ = std::stoi(said.substr(said.rfind(':') + 1));
  }
  [[nodiscard]] std::string address() const {
    return "http://127.0.0.1:" + std::to_string(port_) + "/";
  }
  [[nodiscard]] boost::asio::ip::tcp::endpoint endpoint() const {
    return {boost::asio::ip::address_v4::loopback(), static_cast<unsigned short>(port_)};
  }
  // What is answered to these bytes, up to its end or a second's silence.
  [[nodiscard]] std::string raw(const std::string& bytes) const {
    boost::asio::io_context io;
    boost::asio::ip::tcp::socket socket(io);
    socket.connect(endpoint());
    timeval patience{1, 0};
    ::setsockopt(socket.native_handle(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    boost::system::error_code failed;
    boost::asio::write(socket, boost::asio::buffer(bytes), failed);
    std::string answer;
    char buffer[4096];
    for (;;) {
      const ssize_t count = ::recv(socket.native_handle(), buffer, sizeof buffer, 0);
      if (count <= 0) return answer;
      answer.append(buffer, static_cast<std::size_t>(count));
    }
  }
  [[nodiscard]] std::string get(const std::string& target, const std::string& more = "") const {
    return raw("GET " + target + " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port_) + "\r\n" +
               more + "Connection: close\r\n\r\n");
  }
  using Socket = boost::beast::websocket::stream<boost::asio::ip::tcp::socket>;
  [[nodiscard]] std::unique_ptr<Socket> look(boost::asio::io_context& io) const {
    auto socket = std::make_unique<Socket>(io);
    socket->next_layer().connect(endpoint());
    socket->handshake("127.0.0.1:" + std::to_string(port_), "/ws");
    return socket;
  }

  int port_ = 0;
  std::unique_ptr<Process> view_;
};

}  // namespace waymark::testing
