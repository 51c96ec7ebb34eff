#include "view/web_server.h"

#include <chrono>
#include <optional>
#include <utility>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/strand.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include "view/socket_client.h"

namespace waymark::view {
namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::asio::ip::tcp;

// Nothing from elsewhere, no frames around it, and no scripts but those served here. Images are
// made by the page itself, of what comes over the WebSocket.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::string field(const http::request<http::string_body>& request, http::field name) {
  return std::string(request[name]);
}

// One connection, which asks one thing after the other.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, WebServer& server) : stream_(std::move(socket)), server_(server) {}
  ~Connection() { server_.connectionClosed(); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void read() {
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(server_.options().max_header_bytes));
    parser_->body_limit(server_.options().max_body_bytes);
    stream_.expires_after(std::chrono::seconds(server_.options().request_timeout_s));
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](const beast::error_code& failed, std::size_t) {
                       if (!failed) self->handle();
                     });
  }

 private:
  using Response = http::response<http::string_body>;

  void handle() {
    const auto request = parser_->release();
    const bool upgrade = beast::websocket::is_upgrade(request);
    const WebServer::Reply reply =
        server_.reply({.method = std::string(request.method_string()),
                       .target = std::string(request.target()),
                       .host = field(request, http::field::host),
                       .origin = field(request, http::field::origin),
                       .authorization = field(request, http::field::authorization),
                       .upgrade = upgrade});
    if (reply.becomes_socket) {
      std::make_shared<SocketClient>(std::move(stream_), server_)->accept(request);
      return;
    }
    respond(reply, request.method() == http::verb::head, request.version(), request.keep_alive());
  }

  void respond(const WebServer::Reply& reply, bool head_only, unsigned version, bool keep_alive) {
    response_ = {};
    response_.result(static_cast<unsigned>(reply.status));
    response_.version(version);
    response_.keep_alive(keep_alive);
    response_.set(http::field::content_type, reply.type);
    response_.set(http::field::cache_control, "no-store");
    response_.set("Content-Security-Policy", kPolicy);
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    response_.content_length(reply.body.size());
    if (!head_only) response_.body() = reply.body;
    stream_.expires_after(std::chrono::seconds(server_.options().request_timeout_s));
    serializer_.emplace(response_);
    const auto written = [self = shared_from_this(), keep_alive](const beast::error_code& failed,
                                                                 std::size_t) {
      if (failed || !keep_alive) {
        beast::error_code ignored;
        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
        return;
      }
      self->read();
    };
    if (head_only) {
      http::async_write_header(stream_, *serializer_, written);
    } else {
      http::async_write(stream_, *serializer_, written);
    }
  }

  beast::tcp_stream stream_;
  WebServer& server_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Response response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
};

}  // namespace

WebServer::WebServer(boost::asio::io_context& io, const LiveState& state, Access access,
                     std::map<std::string, PageFile> files, const Options& options)
    : io_(io),
      state_(state),
      access_(std::move(access)),
      files_(std::move(files)),
      options_(options),
      acceptor_(io) {
  for (const auto& [name, file] : files_) file_names_.push_back(name);
}

WebServer::~WebServer() = default;

Status WebServer::listen(const std::string& address, unsigned short port) {
  beast::error_code failed;
  const auto ip = boost::asio::ip::make_address(address, failed);
  const std::string where = address + ":" + std::to_string(port);
  if (failed) return Error{address + ": is no address"};
  const tcp::endpoint endpoint(ip, port);
  acceptor_.open(endpoint.protocol(), failed);
  if (!failed) acceptor_.set_option(tcp::acceptor::reuse_address(true), failed);
  if (!failed) acceptor_.bind(endpoint, failed);
  if (!failed) acceptor_.listen(static_cast<int>(options_.max_connections), failed);
  if (failed) return Error{where + ": cannot listen: " + failed.message()};
  accept();
  return success();
}

void WebServer::accept() {
  acceptor_.async_accept([this](const beast::error_code& failed, tcp::socket socket) {
    if (failed == boost::asio::error::operation_aborted) return;
    // Whoever is too many is hung up on.
    if (!failed && connections_ < options_.max_connections) {
      ++connections_;
      std::make_shared<Connection>(std::move(socket), *this)->read();
    }
    accept();
  });
}

WebServer::Reply WebServer::reply(const RequestHead& request) const {
  const view::Answer checked = checkRequest(request, access_, file_names_);
  switch (checked.resource) {
    case Resource::kFile: {
      const PageFile& file = files_.at(checked.file);
      return {.status = 200, .type = file.type, .body = file.content};
    }
    case Resource::kState:
      return {.status = 200, .type = "application/json", .body = state_.stateText()};
    case Resource::kMetrics:
      return {.status = 200,
              .type = "text/plain; version=0.0.4; charset=utf-8",
              .body = state_.metricsText()};
    case Resource::kCalibration:
      if (const auto text = state_.calibrationFile()) {
        return {.status = 200, .type = "application/yaml", .body = *text};
      }
      return {.status = 404, .body = "nothing is known of a lens yet\n"};
    case Resource::kSocket:
      if (hasRoomForClient()) return {.status = 101, .body = "", .becomes_socket = true};
      return {.status = 503, .body = "too many look already\n"};
    case Resource::kNone:
      break;
  }
  return {.status = checked.status, .body = checked.reason + "\n"};
}

void WebServer::addClient(const std::shared_ptr<SocketClient>& client) {
  clients_.insert(client);
  client->send(std::make_shared<std::string>(commands_ && commands_for_daemon_
                                                 ? R"({"type":"hello","control":true})"
                                                 : R"({"type":"hello","control":false})"));
  if (greeting_) client->send(greeting_);
  client->send(std::make_shared<std::string>(state_.trailText()));
  for (std::size_t i = 0; i < kParts; ++i) {
    const Part part = static_cast<Part>(i);
    client->offer(part, std::make_shared<std::string>(state_.text(part)));
  }
}

void WebServer::removeClient(const std::shared_ptr<SocketClient>& client) {
  clients_.erase(client);
}

void WebServer::publish() {
  for (std::size_t i = 0; i < kParts; ++i) {
    const Part part = static_cast<Part>(i);
    if (state_.version(part) == published_[i]) continue;
    published_[i] = state_.version(part);
    if (clients_.empty()) continue;
    const auto text = std::make_shared<const std::string>(state_.text(part));
    const auto now = clients_;  // one that fails is taken out
    for (const auto& client : now) client->offer(part, text);
  }
}

void WebServer::command(const std::string& text, Answer answer) {
  if (!commands_) {
    return answer(
        R"({"type":"answer","ok":false,"error":"this view only looks: --allow-control"})");
  }
  commands_(text, std::move(answer));
}

}  // namespace waymark::view
