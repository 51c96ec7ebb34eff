#include "view/socket_client.h"

#include <chrono>
#include <utility>

#include <boost/asio/buffer.hpp>

namespace waymark::view {
namespace {

namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;

constexpr std::size_t kMostAnswers = 8;
constexpr int kMostCommands = 2;
constexpr const char* kMore = R"({"command":"more"})";

}  // namespace

SocketClient::SocketClient(beast::tcp_stream stream, WebServer& server)
    : socket_(std::move(stream)), server_(server) {}

void SocketClient::accept(const Request& request) {
  beast::get_lowest_layer(socket_).expires_never();  // the WebSocket has timeouts of its own
  websocket::stream_base::timeout timeout =
      websocket::stream_base::timeout::suggested(beast::role_type::server);
  timeout.idle_timeout = std::chrono::seconds(20);  // asked once in it whether it is there
  socket_.set_option(timeout);
  socket_.read_message_max(server_.options().max_command_bytes);
  server_.addClient(shared_from_this());  // counted from now on
  socket_.async_accept(request, [self = shared_from_this()](const beast::error_code& failed) {
    if (failed) return self->close();
    self->open_ = true;
    self->read();
    self->writeNext();
  });
}

void SocketClient::offer(Part part, Text text) {
  waiting_[static_cast<std::size_t>(part)] = std::move(text);
  writeNext();
}

void SocketClient::send(Text text) {
  if (answers_.size() >= kMostAnswers) return close();  // it asks and does not read
  answers_.push_back(std::move(text));
  writeNext();
}

void SocketClient::read() {
  socket_.async_read(
      received_, [self = shared_from_this()](const beast::error_code& failed, std::size_t) {
        if (failed) return self->close();
        const std::string command = beast::buffers_to_string(self->received_.data());
        self->received_.consume(self->received_.size());
        if (command == kMore) {
          self->beginRound();
        } else if (self->commands_ >= kMostCommands) {
          self->send(std::make_shared<std::string>(
              R"({"type":"answer","ok":false,"error":"the one before is still being done"})"));
        } else {
          ++self->commands_;
          self->server_.command(command, [self](std::string answer) {
            --self->commands_;
            if (self->open_) self->send(std::make_shared<std::string>(std::move(answer)));
          });
        }
        self->read();
      });
}

void SocketClient::beginRound() {
  paced_ = true;
  round_left_ = kParts;
  writeNext();
}

// Answers first, then each part in its turn.
void SocketClient::writeNext() {
  if (!open_ || writing_) return;
  if (!answers_.empty()) {
    writing_ = std::move(answers_.front());
    answers_.pop_front();
  }
  const bool may_send = !paced_ || round_left_ > 0;
  for (std::size_t i = 0; i < kParts && may_send && !writing_; ++i) {
    writing_ = std::exchange(waiting_[next_part_], nullptr);
    next_part_ = (next_part_ + 1) % kParts;
  }
  if (!writing_) {
    // Nothing waits any more: the round is over, if it has begun.
    if (round_left_ < kParts) round_left_ = 0;
    return;
  }
  if (round_left_ > 0) --round_left_;
  socket_.text(true);
  socket_.async_write(boost::asio::buffer(*writing_),
                      [self = shared_from_this()](const beast::error_code& failed, std::size_t) {
                        self->writing_ = nullptr;
                        if (failed) return self->close();
                        self->writeNext();
                      });
}

void SocketClient::close() {
  open_ = false;
  beast::error_code ignored;
  beast::get_lowest_layer(socket_).socket().close(ignored);
  server_.removeClient(shared_from_this());
}

}  // namespace waymark::view
