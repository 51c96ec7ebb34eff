// One page that looks, over a WebSocket.
#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <memory>
#include <string>

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include "view/web_server.h"

namespace waymark::view {

using Text = std::shared_ptr<const std::string>;

class SocketClient : public std::enable_shared_from_this<SocketClient> {
 public:
  using Request = boost::beast::http::request<boost::beast::http::string_body>;

  // The server must outlive it.
  SocketClient(boost::beast::tcp_stream stream, WebServer& server);

  void accept(const Request& request);
  // Sent when the client is ready for it; what is still waiting then is left out for newer.
  void offer(Part part, Text text);
  // Sent whatever comes; a few may wait.
  void send(Text text);

 private:
  void read();
  void beginRound();
  void writeNext();
  void close();

  boost::beast::websocket::stream<boost::beast::tcp_stream> socket_;
  WebServer& server_;
  boost::beast::flat_buffer received_;
  std::array<Text, kParts> waiting_;
  std::deque<Text> answers_;
  std::size_t next_part_ = 0;
  int commands_ = 0;  // whose answer is not there yet
  Text writing_;
  bool open_ = false;
  // A page that says when it has drawn what it got is sent one round after the other.
  bool paced_ = false;
  std::size_t round_left_ = 0;  // parts that may still be sent in it
};

}  // namespace waymark::view
