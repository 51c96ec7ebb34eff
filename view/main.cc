// waymark-view: what a daemon publishes, as a page for browsers. It listens and serves; nothing of
// it can delay a pose.
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>

#include "base/clock.h"
#include "daemon/configuration.h"
#include "daemon/publish/lcm_link.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "view/control_link.h"
#include "view/lcm_input.h"
#include "view/live_state.h"
#include "view/page_files.h"
#include "view/web_server.h"

namespace waymark::view {
namespace {

enum ExitCode { kDone = 0, kFault = 1, kBadInput = 2 };

struct ViewArguments {
  std::string listen = "127.0.0.1";
  int port = 8787;
  std::string url = daemon::Configuration::Publish{}.url;
  std::string channel_prefix = daemon::Configuration::Publish{}.channel_prefix;
  std::string socket;
  std::string token_file;
  bool allow_control = false;
  std::string page = WAYMARK_VIEW_PAGE;
  std::string three = "/usr/share/javascript/three";
  std::string health = WAYMARK_VIEW_HEALTH;
};

// Who may ask: beyond this computer only who has the token.
Result<Access> accessOf(const ViewArguments& arguments) {
  Access access;
  boost::system::error_code failed;
  const auto address = boost::asio::ip::make_address(arguments.listen, failed);
  if (failed) return Error{"--listen: '" + arguments.listen + "' is no address"};
  if (!address.is_loopback() && arguments.token_file.empty()) {
    return Error{"--listen " + arguments.listen +
                 ": others could look: --token-file FILE says who may (16 letters and digits or "
                 "more in it; the page is opened with #token=...)"};
  }
  if (address.is_v6()) access.hosts.push_back("[" + arguments.listen + "]");
  if (address.is_v4()) access.hosts.push_back(arguments.listen);
  if (arguments.token_file.empty()) return access;
  constexpr std::size_t kMost = 1 << 20;
  const Result<std::string> text = io::readTextFile(arguments.token_file, kMost);
  if (!text) return text.error();
  std::string token = *text;
  while (!token.empty() && (token.back() == '\n' || token.back() == '\r')) token.pop_back();
  if (!isToken(token)) {
    return Error{arguments.token_file +
                 ": must be one line of 16 to 200 letters, digits, '-' and '_'"};
  }
  access.token = std::move(token);
  return access;
}

// Thirty times a second: faster is for no eye.
class Ticker {
 public:
  Ticker(boost::asio::io_context& io, LiveState& state, WebServer& server)
      : timer_(io), state_(state), server_(server) {}

  void next() {
    timer_.expires_after(std::chrono::milliseconds(33));
    timer_.async_wait([this](const boost::system::error_code& stopped) {
      if (stopped) return;
      state_.tick(monotonicNs());
      server_.publish();
      next();
    });
  }

 private:
  boost::asio::steady_timer timer_;
  LiveState& state_;
  WebServer& server_;
};

Status serve(const ViewArguments& arguments) {
  if (!daemon::multicastAddress(arguments.url)) {
    return Error{"--url: not a multicast address: " + arguments.url};
  }
  Result<Access> access = accessOf(arguments);
  if (!access) return access.error();
  const bool needs_token = !access->token.empty();
  auto files = readPageFiles(arguments.page, arguments.three, arguments.health);
  if (!files) return files.error();
  boost::asio::io_context io(1);
  LiveState state;
  WebServer server(io, state, std::move(access).value(), std::move(files).value(), {});
  LcmInput input(io, arguments.url, arguments.channel_prefix, state);
  ControlLink control(io, arguments.socket, state);
  if (arguments.allow_control) {
    server.setCommandHandler([&control](const std::string& command, WebServer::Answer answer) {
      control.command(command, std::move(answer));
    });
  }
  const Status listening =
      server.listen(arguments.listen, static_cast<unsigned short>(arguments.port));
  if (!listening) return listening;
  std::printf("http://%s:%u/%s\n", arguments.listen.c_str(), server.port(),
              needs_token ? "#token=..." : "");
  std::fflush(stdout);
  boost::asio::signal_set stop(io, SIGINT, SIGTERM);
  stop.async_wait([&io](const boost::system::error_code&, int) { io.stop(); });
  Ticker ticker(io, state, server);
  input.start();
  control.start();
  ticker.next();
  io.run();
  return success();
}

void addOptions(CLI::App& app, ViewArguments& a) {
  app.add_option("--listen", a.listen,
                 "Address to serve the page at; any but this computer's "
                 "own (127.0.0.1, ::1) needs --token-file")
      ->capture_default_str();
  app.add_option("--port", a.port, "0: any that is free; it is printed")
      ->capture_default_str()
      ->check(CLI::Range(0, 65535));
  app.add_option("--url", a.url, "LCM URL")->capture_default_str();
  app.add_option("--channel-prefix", a.channel_prefix, "Channels begin with this")
      ->capture_default_str();
  app.add_option("--socket", a.socket,
                 "The daemon's control socket; else where daemons usually listen");
  app.add_option("--token-file", a.token_file,
                 "A file with a token, which who looks must know: 16 letters or more");
  app.add_flag("--allow-control", a.allow_control,
               "The page may save, load and reset the map, and start and stop recording");
  app.add_option("--page", a.page, "Directory of the page's files")->capture_default_str();
  app.add_option("--three", a.three, "Directory of three.js")->capture_default_str();
  app.add_option("--health", a.health, "What helps when counters grow: docs/health.md")
      ->capture_default_str();
}

int run(int argc, char** argv) {
  CLI::App app{"Shows in a browser what waymarkd publishes.", "waymark-view"};
  ViewArguments arguments;
  addOptions(app, arguments);
  app.set_version_flag("--version", "waymark-view " WAYMARK_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help and --version
    std::fprintf(stderr, "waymark-view: %s\n", io::oneLine(e.what()).c_str());
    return kBadInput;
  }
  const Status served = serve(arguments);
  if (served) return kDone;
  std::fprintf(stderr, "waymark-view: %s\n", served.error().message.c_str());
  return kBadInput;
}

}  // namespace
}  // namespace waymark::view

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  try {
    return waymark::view::run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "waymark-view: internal error: %s\n",
                 waymark::io::oneLine(e.what()).c_str());
    return waymark::view::kFault;
  }
}
