// What it costs waymarkd that pages look at it: a daemon on a simulated camera, waymark-view, and
// clients that read all that they are sent. First nobody looks, then all of them do. Exit code 1
// where the daemon lost a frame, or a client heard nothing, while they did.
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "base/clock.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"

namespace waymark {
namespace {

namespace beast = boost::beast;
namespace fs = std::filesystem;
using boost::asio::ip::tcp;
using nlohmann::json;
using std::chrono::milliseconds;

struct Arguments {
  int clients = 16;
  double rate_hz = 150.0;
  double seconds = 60.0;
  int width = 640;
  int height = 480;
  int priority = 0;  // of the daemon's threads, SCHED_FIFO
  bool no_image = false;
};

std::string configuration(const Arguments& a, const std::string& url) {
  return "[camera]\nsource = 'sim:walls'\nrate_hz = " + std::to_string(a.rate_hz) +
         "\n[camera.simulator]\nloop_s = 1\nwidth = " + std::to_string(a.width) +
         "\nheight = " + std::to_string(a.height) + "\n[publish]\nurl = '" + url +
         "'\n[control]\nsocket = 'control.sock'\n[slam]\ndictionary = 'ARUCO_MIP_36h12'\n"
         "marker_size_m = 0.165\n[realtime]\ncapture_priority = " +
         std::to_string(a.priority) + "\nslam_priority = " + std::to_string(a.priority) +
         "\npublisher_priority = " + std::to_string(a.priority) + "\n";
}

// A page that takes all it gets.
class Client {
 public:
  Client(boost::asio::io_context& io, int port) : socket_(io) {
    socket_.next_layer().connect(
        {boost::asio::ip::address_v4::loopback(), static_cast<unsigned short>(port)});
    socket_.handshake("127.0.0.1:" + std::to_string(port), "/ws");
    socket_.read_message_max(std::size_t{16} << 20U);
    read();
  }
  [[nodiscard]] long messages() const { return messages_; }
  [[nodiscard]] long images() const { return images_; }
  [[nodiscard]] double megabytes() const { return 1e-6 * static_cast<double>(bytes_); }
  [[nodiscard]] bool cutOff() const { return cut_off_; }

 private:
  void read() {
    socket_.async_read(buffer_, [this](const beast::error_code& failed, std::size_t size) {
      cut_off_ = static_cast<bool>(failed);
      if (failed) return;
      ++messages_;
      bytes_ += size;
      const std::string text = beast::buffers_to_string(buffer_.data());
      if (text.find("data:image/jpeg") != std::string::npos) ++images_;
      buffer_.consume(buffer_.size());
      read();
    });
  }

  beast::websocket::stream<tcp::socket> socket_;
  beast::flat_buffer buffer_;
  long messages_ = 0;
  long images_ = 0;
  std::size_t bytes_ = 0;
  bool cut_off_ = false;
};

class Setup {
 public:
  explicit Setup(const Arguments& arguments) {
    std::ofstream(directory_ / "waymarkd.toml") << configuration(arguments, url_);
    daemon_ = std::make_unique<testing::Process>(
        std::vector<std::string>{WAYMARKD, "--config", (directory_ / "waymarkd.toml").string()},
        directory_ / "waymarkd.err");
    std::vector<std::string> command = {WAYMARK_VIEW,
                                        "--port",
                                        "0",
                                        "--url",
                                        url_,
                                        "--page",
                                        WAYMARK_VIEW_PAGE,
                                        "--health",
                                        WAYMARK_HEALTH_MD,
                                        "--socket",
                                        (directory_ / "control.sock").string()};
    if (arguments.no_image) command.emplace_back("--no-image");
    view_ = std::make_unique<testing::Process>(command, directory_ / "view.err",
                                               directory_ / "view.out");
  }

  // Empty where there is no answer.
  [[nodiscard]] json status() const {
    const testing::ProgramResult result =
        testing::runProgram({WAYMARK_PROGRAM, "ctl", "--socket",
                             (directory_ / "control.sock").string(), "status", "--json"});
    return result.exit_code == 0 ? json::parse(result.out) : json();
  }
  // The view's; 0 where it does not listen yet.
  [[nodiscard]] int port() const {
    const std::string said = testing::readFile(directory_ / "view.out");
    const std::size_t colon = said.rfind(':');
    return colon == std::string::npos ? 0 : std::atoi(said.c_str() + colon + 1);
  }
  // Seconds of processor time, of the thread of this name, or of all threads.
  [[nodiscard]] double cpuOf(const testing::Process& process, const std::string& thread) const {
    double seconds = 0.0;
    const fs::path tasks = "/proc/" + std::to_string(process.pid()) + "/task";
    for (const auto& task : fs::directory_iterator(tasks)) {
      const std::string stat = testing::readFile(task.path() / "stat");
      const std::size_t open = stat.find('(');
      const std::size_t close = stat.rfind(')');
      if (!thread.empty() && stat.substr(open + 1, close - open - 1) != thread) continue;
      long user = 0;
      long system = 0;
      // Behind the name: state, and ten more fields.
      std::sscanf(stat.c_str() + close + 2, "%*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %ld %ld",
                  &user, &system);
      seconds += static_cast<double>(user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
    }
    return seconds;
  }
  [[nodiscard]] const testing::Process& daemon() const { return *daemon_; }
  [[nodiscard]] const testing::Process& view() const { return *view_; }
  [[nodiscard]] std::string said() const { return daemon_->stderrText(); }

 private:
  const testing::TemporaryDirectory directory_;
  const std::string url_ = testing::randomUrl();
  std::unique_ptr<testing::Process> daemon_;
  std::unique_ptr<testing::Process> view_;
};

struct Row {
  long frames = 0;
  long dropped = 0;
  long missed = 0;            // deadlines
  double slam_ms = 0.0;       // of processor time, a frame
  double preview_ms = 0.0;    // likewise
  double view_percent = 0.0;  // of a processor
};

long droppedIn(const json& counters) {
  long dropped = 0;
  for (const auto& [name, value] : counters.items()) {
    if (name.starts_with("dropped.")) dropped += value.get<long>();
  }
  return dropped;
}

// What happened while `meanwhile` went on.
Row measure(const Setup& setup, double seconds, const std::function<void()>& meanwhile) {
  const json before = setup.status()["counters"];
  const double slam_s = setup.cpuOf(setup.daemon(), "wm-slam");
  const double preview_s = setup.cpuOf(setup.daemon(), "wm-preview");
  const double view_s = setup.cpuOf(setup.view(), "");
  const std::int64_t begin_ns = monotonicNs();
  const auto end_ns = begin_ns + static_cast<std::int64_t>(1e9 * seconds);
  while (monotonicNs() < end_ns) meanwhile();
  const json after = setup.status()["counters"];
  Row row;
  row.frames = after.value("camera.frames", 0L) - before.value("camera.frames", 0L);
  row.dropped = droppedIn(after) - droppedIn(before);
  row.missed = after.value("deadline.missed", 0L) - before.value("deadline.missed", 0L);
  const double frames = std::max(1.0, static_cast<double>(row.frames));
  row.slam_ms = 1e3 * (setup.cpuOf(setup.daemon(), "wm-slam") - slam_s) / frames;
  row.preview_ms = 1e3 * (setup.cpuOf(setup.daemon(), "wm-preview") - preview_s) / frames;
  row.view_percent = 100.0 * (setup.cpuOf(setup.view(), "") - view_s) / seconds;
  return row;
}

void print(const char* what, const Row& row) {
  std::printf("%-16s %8ld %8ld %10ld %12.3f %12.3f %10.1f\n", what, row.frames, row.dropped,
              row.missed, row.slam_ms, row.preview_ms, row.view_percent);
}

bool waitUntil(const std::function<bool()>& holds) {
  constexpr int kTries = 600;
  for (int i = 0; i < kTries; ++i) {
    if (holds()) return true;
    std::this_thread::sleep_for(milliseconds(100));
  }
  return false;
}

int run(const Arguments& arguments) {
  if (!testing::ensureMulticastRoute()) {
    std::fprintf(stderr, "view_load: no multicast route\n");
    return 2;
  }
  const Setup setup(arguments);
  const bool tracks = waitUntil([&] {
    const json now = setup.status();
    return setup.port() != 0 && now.is_object() && now.value("status", "") == "tracking";
  });
  if (!tracks) {
    std::fprintf(stderr, "view_load: the daemon does not track: %s\n", setup.said().c_str());
    return 2;
  }
  std::this_thread::sleep_for(milliseconds(5000));  // the map is there
  std::printf("%d clients, %.0f Hz, %d x %d, %.0f s each\n%-16s %8s %8s %10s %12s %12s %10s\n",
              arguments.clients, arguments.rate_hz, arguments.width, arguments.height,
              arguments.seconds, "", "frames", "dropped", "deadlines", "SLAM ms", "preview ms",
              "view %");
  print("nobody looks",
        measure(setup, arguments.seconds, [] { std::this_thread::sleep_for(milliseconds(20)); }));
  boost::asio::io_context io;
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < arguments.clients; ++i) {
    clients.push_back(std::make_unique<Client>(io, setup.port()));
  }
  io.run_for(milliseconds(2000));  // all of them have what greets them
  const Row looked_at = measure(setup, arguments.seconds, [&] { io.run_for(milliseconds(20)); });
  print("all look", looked_at);
  bool sound = looked_at.dropped == 0 && looked_at.frames > 0;
  long fewest = clients.empty() ? 0 : clients.front()->messages();
  long images = 0;
  double megabytes = 0.0;
  for (const auto& client : clients) {
    fewest = std::min(fewest, client->messages());
    images += client->images();
    megabytes += client->megabytes();
    sound = sound && !client->cutOff() && client->messages() > 0;
  }
  std::printf("each client: %ld messages or more, %.1f images, %.1f MB\n", fewest,
              static_cast<double>(images) / std::max(1, arguments.clients),
              megabytes / std::max(1, arguments.clients));
  return sound ? 0 : 1;
}

}  // namespace
}  // namespace waymark

int main(int argc, char** argv) {
  waymark::Arguments arguments;
  CLI::App app{"What it costs waymarkd that pages look at it."};
  app.add_option("--clients", arguments.clients, "Pages")->capture_default_str();
  app.add_option("--rate", arguments.rate_hz, "Frames a second")->capture_default_str();
  app.add_option("--seconds", arguments.seconds, "Each half")->capture_default_str();
  app.add_option("--width", arguments.width, "Pixels")->capture_default_str();
  app.add_option("--height", arguments.height, "Pixels")->capture_default_str();
  app.add_option("--priority", arguments.priority,
                 "Of the daemon's threads, SCHED_FIFO, as on a robot; 0: as all others")
      ->capture_default_str();
  app.add_flag("--no-image", arguments.no_image, "The view asks for no images");
  CLI11_PARSE(app, argc, argv);
  return waymark::run(arguments);
}
