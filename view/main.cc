// waymark-view: what a daemon publishes, as a page for browsers. It listens and serves; nothing of
// it can delay a pose.
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>

#include "base/clock.h"
#include "base/program_directory.h"
#include "daemon/configuration.h"
#include "daemon/publish/lcm_link.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "view/control_link.h"
#include "view/lcm_input.h"
#include "view/live_state.h"
#include "view/page_files.h"
#include "view/playback.h"
#include "view/result_view.h"
#include "view/web_server.h"

namespace waymark::view {
namespace {

namespace fs = std::filesystem;

enum ExitCode { kDone = 0, kFault = 1, kBadInput = 2 };

// What was installed with this program, wherever that is: a package is built for one place and
// installed in another.
fs::path installedBeside(const char* from_program) {
  return (programDirectory() / from_program).lexically_normal();
}

struct ViewArguments {
  std::string source;  // results or a recording; empty: what a daemon publishes
  std::string truth;
  std::string listen = "127.0.0.1";
  int port = 8787;
  std::string url = daemon::Configuration::Publish{}.url;
  std::string channel_prefix = daemon::Configuration::Publish{}.channel_prefix;
  std::string pose_channel = daemon::Configuration::Publish{}.pose_channel;
  std::string socket;
  std::string token_file;
  bool allow_control = false;
  bool no_image = false;
  std::string page = installedBeside(WAYMARK_VIEW_PAGE);
  std::string three = "/usr/share/javascript/three";
  std::string health = (fs::path(page) / "health.md").string();
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

// What is over: results of a run, or a recording.
class Offline {
 public:
  static Result<std::unique_ptr<Offline>> open(const ViewArguments& arguments) {
    auto offline = std::make_unique<Offline>();
    std::error_code error;
    if (fs::is_directory(arguments.source, error)) {
      Result<ResultView> read = readResultView(arguments.source, arguments.truth);
      if (!read) return read.error();
      offline->result_ = std::move(read).value();
      return offline;
    }
    if (!arguments.truth.empty()) return Error{"--truth needs a directory of results"};
    Result<Playback> opened =
        Playback::open(arguments.source, arguments.channel_prefix, arguments.pose_channel);
    if (!opened) return opened.error();
    offline->playback_.emplace(std::move(opened).value());
    return offline;
  }

  void start(WebServer& server, LiveState& state) {
    if (result_) {
      for (const map_t& part : result_->map) state.add(part, monotonicNs());
      for (const natural_map_t& part : result_->natural_map) state.add(part, monotonicNs());
      server.setGreeting(result_->result.dump(-1, ' ', false, io::Json::error_handler_t::replace));
      return;
    }
    server.setCommandHandler(
        [this](const std::string& command, const WebServer::Answer& answer) {
          answer(playback_->command(command).dump());
        },
        /*for_daemon=*/false);
  }
  void tick(std::int64_t now_ns, LiveState* state) {
    if (playback_) playback_->tick(now_ns, state);
  }

 private:
  std::optional<ResultView> result_;
  std::optional<Playback> playback_;
};

// Thirty times a second: faster is for no eye.
class Ticker {
 public:
  // offline: may be null.
  Ticker(boost::asio::io_context& io, LiveState& state, WebServer& server, Offline* offline)
      : timer_(io), state_(state), server_(server), offline_(offline) {}

  void next() {
    timer_.expires_after(std::chrono::milliseconds(33));
    timer_.async_wait([this](const boost::system::error_code& stopped) {
      if (stopped) return;
      watched_ = watched_ || server_.hasClients();
      if (offline_ != nullptr && watched_) offline_->tick(monotonicNs(), &state_);
      state_.tick(monotonicNs());
      server_.publish();
      next();
    });
  }

 private:
  boost::asio::steady_timer timer_;
  LiveState& state_;
  WebServer& server_;
  Offline* offline_;
  bool watched_ = false;  // a recording does not begin before somebody looks
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
  std::unique_ptr<Offline> offline;
  if (!arguments.source.empty()) {
    auto opened = Offline::open(arguments);
    if (!opened) return opened.error();
    offline = std::move(opened).value();
  }
  boost::asio::io_context io(1);
  LiveState state;
  WebServer server(io, state, std::move(access).value(), std::move(files).value(), {});
  LcmInput input(io, arguments.url, arguments.channel_prefix, arguments.pose_channel, state);
  ControlLink control(io, arguments.socket, state);
  if (!arguments.no_image) control.setLookedAt([&server] { return server.hasClients(); });
  if (arguments.allow_control) {
    server.setCommandHandler([&control](const std::string& command, WebServer::Answer answer) {
      control.command(command, std::move(answer));
    });
  }
  Status listening = server.listen(arguments.listen, static_cast<unsigned short>(arguments.port));
  if (!listening) return listening;
  std::printf("http://%s:%u/%s\n", arguments.listen.c_str(), server.port(),
              needs_token ? "#token=..." : "");
  std::fflush(stdout);
  boost::asio::signal_set stop(io, SIGINT, SIGTERM);
  stop.async_wait([&io](const boost::system::error_code&, int) { io.stop(); });
  Ticker ticker(io, state, server, offline.get());
  if (offline) {
    offline->start(server, state);
  } else {
    input.start();
    control.start();
  }
  ticker.next();
  io.run();
  return success();
}

void addOptions(CLI::App& app, ViewArguments& a) {
  app.add_option(
      "SOURCE", a.source,
      "A directory of results of waymark run, or an event log of waymarkd: shown instead of "
      "what a daemon publishes");
  app.add_option("--truth", a.truth, "TUM trajectory: the errors of results against it are shown");
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
  app.add_option("--pose-channel", a.pose_channel, "Channel of the body's pose")
      ->capture_default_str();
  app.add_option("--socket", a.socket,
                 "The daemon's control socket; else where daemons usually listen");
  app.add_option("--token-file", a.token_file,
                 "A file with a token, which who looks must know: 16 letters or more");
  app.add_flag("--allow-control", a.allow_control,
               "The page may save, load and reset the map, and start and stop recording");
  app.add_flag("--no-image", a.no_image, "Never ask the daemon for images of its camera");
  app.add_option("--page", a.page, "Directory of the page's files")->capture_default_str();
  app.add_option("--three", a.three, "Directory of three.js")->capture_default_str();
  app.add_option("--health", a.health, "What helps when counters grow: docs/health.md")
      ->capture_default_str();
}

int run(int argc, char** argv) {
  CLI::App app{
      "Shows in a browser what waymarkd publishes, what it recorded, or what waymark run made.",
      "waymark-view"};
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
