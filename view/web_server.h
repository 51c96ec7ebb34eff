// Serves the page, what belongs to it, and the live state over WebSockets; on one thread, and never
// waiting for a client: who reads slowly gets what is newest when it is ready for more, and who
// asks for too much is let go.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>

#include "base/result.h"
#include "view/live_state.h"
#include "view/request_check.h"

namespace waymark::view {

// One file of the page.
struct PageFile {
  std::string type;  // of its content
  std::string content;
};

class SocketClient;

class WebServer {
 public:
  struct Options {
    std::size_t max_connections = 64;      // browsers open some at once
    std::size_t max_clients = 32;          // of these, WebSockets
    std::size_t max_header_bytes = 8192;   // of a request
    std::size_t max_body_bytes = 1024;     // nobody needs one
    std::size_t max_command_bytes = 1024;  // of a message from a page
    int request_timeout_s = 10;            // for a request, and for its answer to be taken
  };

  // What a page wants done, as JSON; `answer` may be called later, with one JSON object.
  using Answer = std::function<void(std::string)>;
  using CommandHandler = std::function<void(const std::string& command, Answer answer)>;

  WebServer(boost::asio::io_context& io, const LiveState& state, Access access,
            std::map<std::string, PageFile> files, const Options& options);
  ~WebServer();
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;

  // Where nobody handles commands, they are refused. for_daemon: they are the daemon's, and the
  // page has buttons for them; else a recording's.
  void setCommandHandler(CommandHandler handler, bool for_daemon = true) {
    commands_ = std::move(handler);
    commands_for_daemon_ = for_daemon;
  }
  // A message that every page gets first.
  void setGreeting(std::string text) {
    greeting_ = std::make_shared<const std::string>(std::move(text));
  }

  // port 0: any; port() says which.
  [[nodiscard]] Status listen(const std::string& address, unsigned short port);
  [[nodiscard]] unsigned short port() const { return acceptor_.local_endpoint().port(); }

  // Gives every client what has changed since it was called last.
  void publish();

  // For the connections.
  struct Reply {
    int status = 200;
    std::string type = "text/plain; charset=utf-8";
    std::string body;
    bool becomes_socket = false;
  };
  [[nodiscard]] Reply reply(const RequestHead& request) const;
  [[nodiscard]] const Options& options() const { return options_; }
  [[nodiscard]] bool hasClients() const { return !clients_.empty(); }
  [[nodiscard]] bool hasRoomForClient() const { return clients_.size() < options_.max_clients; }
  void addClient(const std::shared_ptr<SocketClient>& client);
  void removeClient(const std::shared_ptr<SocketClient>& client);
  void connectionClosed() { --connections_; }
  void command(const std::string& text, Answer answer);

 private:
  void accept();

  boost::asio::io_context& io_;
  const LiveState& state_;
  const Access access_;
  const std::map<std::string, PageFile> files_;
  std::vector<std::string> file_names_;
  const Options options_;
  boost::asio::ip::tcp::acceptor acceptor_;
  CommandHandler commands_;
  bool commands_for_daemon_ = true;
  std::shared_ptr<const std::string> greeting_;
  std::set<std::shared_ptr<SocketClient>> clients_;
  std::size_t connections_ = 0;
  std::array<std::uint64_t, kParts> published_{};
};

}  // namespace waymark::view
