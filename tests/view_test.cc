// waymark-view as its users meet it: the page in a browser, a hostile client, a slow one.
#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <poll.h>

#include "base/clock.h"
#include "tests/browser.h"
#include "tests/multicast.h"
#include "tests/process.h"
#include "tests/running_daemon.h"
#include "tests/temporary_directory.h"
#include <waymark/detections_t.hpp>
#include <waymark/health_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::testing {
namespace {

namespace beast = boost::beast;
namespace fs = std::filesystem;
namespace http = boost::beast::http;
using boost::asio::ip::tcp;
using nlohmann::json;
using std::chrono::milliseconds;

// Publishes what a daemon with 48 markers would, until it is taken away.
class PretendedDaemon {
 public:
  PretendedDaemon(const std::string& url, std::string prefix, double rate_hz = 60.0)
      : lcm_(lcm_create(url.c_str())),
        prefix_(std::move(prefix)),
        period_(static_cast<int>(1e6 / rate_hz)),
        thread_([this] { run(); }) {}
  ~PretendedDaemon() {
    stop_ = true;
    thread_.join();
    lcm_destroy(lcm_);
  }
  PretendedDaemon(const PretendedDaemon&) = delete;
  PretendedDaemon& operator=(const PretendedDaemon&) = delete;

  std::atomic<bool> no_camera{false};

 private:
  template <typename Message>
  void send(const char* channel, const Message& message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    lcm_publish(lcm_, (prefix_ + channel).c_str(), bytes.data(),
                static_cast<unsigned>(bytes.size()));
  }

  void run() {
    const std::int64_t begin_ns = monotonicNs();
    for (int frame = 0; !stop_; ++frame) {
      sendPose(frame);
      sendDetections(frame);
      if (frame % 30 == 0) sendMap();
      if (frame % 30 == 0) sendHealth(frame, monotonicNs() - begin_ns);
      std::this_thread::sleep_for(period_);
    }
  }

  void sendPose(int frame) {
    pose_t pose{};
    pose.sequence = frame;
    pose.monotonic_ns = monotonicNs();
    if (no_camera) {
      pose.status = pose_t::STATUS_NO_CAMERA;
      pose.reason = "/dev/video0: unplugged";
      return send("POSE", pose);
    }
    pose.status = pose_t::STATUS_TRACKING;
    pose.source = pose_t::SOURCE_MARKERS;
    pose.had_pose = 1;
    const double angle = 0.02 * frame;
    pose.p_w_c[0] = 1.2 * std::sin(angle);
    pose.p_w_c[1] = 0.1 * std::sin(3.0 * angle);
    pose.p_w_c[2] = 1.2 * std::cos(angle);
    pose.q_w_c[0] = std::cos(0.5 * angle);
    pose.q_w_c[2] = std::sin(0.5 * angle);
    pose.covariance[0] = pose.covariance[7] = pose.covariance[14] = 1e-6;
    pose.markers_used = 5;
    pose.reprojection_rms_px = 0.08;
    pose.latency_ns = 2'400'000 + 400'000 * (frame % 9);
    send("POSE", pose);
  }

  // On the four walls of a room.
  void sendMap() {
    map_t map{};
    map.revision = 3;
    map.piece_count = 1;
    map.dictionary = "ARUCO_MIP_36h12";
    map.count = map.marker_count = 48;
    map.keyframe_count = 118;
    for (int i = 0; i < 48; ++i) {
      marker_t marker{};
      marker.id = i;
      marker.size = 0.165;
      const double wall = 0.5 * M_PI * (i / 12);
      const double along = 0.5 * (i % 6) - 1.25;
      const double high = i % 12 < 6 ? -0.35 : 0.35;
      marker.p_w_m[0] = 2.5 * std::sin(wall) + along * std::cos(wall);
      marker.p_w_m[1] = high;
      marker.p_w_m[2] = 2.5 * std::cos(wall) - along * std::sin(wall);
      // Its face looks inwards: half a turn about x, then about y.
      marker.q_w_m[1] = std::cos(0.5 * wall);
      marker.q_w_m[3] = -std::sin(0.5 * wall);
      marker.state = i == 7 ? marker_t::STATE_UNDECIDED : marker_t::STATE_MAPPED;
      marker.views = 9 + i;
      marker.sigma_m = 0.002 + 0.0005 * i;
      map.markers.push_back(marker);
    }
    map.unposed_count = 1;
    map.unposed.resize(1);
    map.unposed[0].id = 99;
    map.unposed[0].state = unposed_marker_t::STATE_QUARANTINED;
    send("MAP", map);
  }

  void sendDetections(int frame) {
    detections_t detections{};
    detections.sequence = frame;
    detections.count = detections.seen = 3;
    for (int i = 0; i < 3; ++i) {
      const double x = 120.0 + 160.0 * i + 40.0 * std::sin(0.05 * frame);
      const double y = 150.0 + 40.0 * i;
      detections.detections.push_back(
          {i, i == 2 ? 1 : 0, {{x, y}, {x + 80, y + 6}, {x + 76, y + 84}, {x - 4, y + 78}}});
    }
    send("DETECTIONS", detections);
  }

  void sendHealth(int frame, std::int64_t uptime_ns) {
    health_t health{};
    health.uptime_ns = uptime_ns;
    health.version = "0.1.0";
    health.status = pose_t::STATUS_TRACKING;
    health.camera = health_t::CAMERA_RUNNING;
    health.frame_rate_hz = health.pose_rate_hz = 60.0;
    health.latency_median_ns = 2'600'000;
    health.latency_p99_ns = 5'000'000;
    health.latency_max_ns = 5'600'000;
    health.processing_median_ns = 900'000;
    health.processing_max_ns = 2'100'000;
    health.counters = {{"dropped.queue", frame / 30}, {"camera.frames", frame}};
    health.counter_count = 2;
    send("HEALTH", health);
  }

  lcm_t* lcm_;
  const std::string prefix_;
  const std::chrono::microseconds period_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

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
  [[nodiscard]] tcp::endpoint endpoint() const {
    return {boost::asio::ip::address_v4::loopback(), static_cast<unsigned short>(port_)};
  }
  // What is answered to these bytes, up to its end or a second's silence.
  [[nodiscard]] std::string raw(const std::string& bytes) const {
    boost::asio::io_context io;
    tcp::socket socket(io);
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
  using Socket = beast::websocket::stream<tcp::socket>;
  [[nodiscard]] std::unique_ptr<Socket> look(boost::asio::io_context& io) const {
    auto socket = std::make_unique<Socket>(io);
    socket->next_layer().connect(endpoint());
    socket->handshake("127.0.0.1:" + std::to_string(port_), "/ws");
    return socket;
  }

  int port_ = 0;
  std::unique_ptr<Process> view_;
};

constexpr const char* kText = "document.getElementById('state').textContent";

TEST_F(ViewTest, ThePageShowsTheMapAndFollowsTheDaemon) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  view();
  auto daemon = std::make_unique<PretendedDaemon>(url_, "TEST_");
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers === 48"));
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().segments > 50")) << "it moves";
  EXPECT_EQ(browser->evaluate("document.querySelectorAll('#markers tbody tr').length"), 49);
  EXPECT_TRUE(
      browser->becomes("document.getElementById('counters').textContent.includes("
                       "'dropped.queue') && document.getElementById('counters')."
                       "textContent.includes('the SLAM loop is late')"));
  EXPECT_EQ(browser->evaluate("document.getElementById('buttons').hidden"), true)
      << "it only looks";

  // In light and dark, on a desk and in a hand; by keys.
  for (const bool phone : {false, true}) {
    browser->resize(phone ? 390 : 1280, phone ? 844 : 800, phone);
    for (const bool dark : {false, true}) {
      browser->dark(dark);
      std::this_thread::sleep_for(milliseconds(700));
      const fs::path file = directory_ / "picture.png";
      browser->screenshot(file);
      const cv::Mat picture = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
      ASSERT_FALSE(picture.empty());
      cv::Scalar mean, scatter;
      cv::meanStdDev(picture, mean, scatter);
      EXPECT_GT(scatter[0], 15.0) << "there is something on it";
      EXPECT_EQ(mean[0] < 110.0, dark);
      if (const char* keep = std::getenv("WAYMARK_PICTURES")) {
        const std::string name =
            std::string(phone ? "phone" : "desk") + (dark ? "_dark" : "_light");
        fs::copy(file, fs::path(keep) / (name + ".png"), fs::copy_options::overwrite_existing);
      }
    }
    EXPECT_LE(browser->evaluate("document.documentElement.scrollWidth - innerWidth"), 0)
        << "nothing hangs over the side";
  }
  browser->press("u");
  EXPECT_EQ(browser->evaluate("document.getElementById('sigma').getAttribute('aria-pressed')"),
            "true");

  daemon->no_camera = true;
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no camera'"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('why').textContent.startsWith("
                       "'/dev/video0: unplugged')"));
  // The daemon goes, and another one comes.
  daemon.reset();
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no daemon'"));
  daemon = std::make_unique<PretendedDaemon>(url_, "TEST_");
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
  // So does what serves the page.
  view_->signal(SIGTERM);
  EXPECT_EQ(view_->wait(milliseconds(5000)), 0);
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no connection'"));
  view();
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers === 48"));
}

TEST_F(ViewTest, ButtonsDoWhatTheySay) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(400, 300, false);  // a small map leaves the daemon some of the processor
  start(configuration("", "[record]\ndirectory = 'logs'\nat_start = false\n"));
  view({"--allow-control"});
  browser->open(address());
  ASSERT_TRUE(browser->becomes("document.getElementById('buttons').hidden === false"));
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 2"));
  const auto button = [](const std::string& command) {
    return "document.querySelector('[data-command=" + command + "]')";
  };
  const auto recorder = [&] { return status()["recorder"]["state"].get<std::string>(); };
  EXPECT_TRUE(browser->becomes(button("record-stop") + ".disabled"));
  browser->evaluate(button("record-start") + ".click()");
  EXPECT_TRUE(browser->becomes("document.getElementById('answer').textContent === 'done'", 60));
  EXPECT_TRUE(eventually([&] { return recorder() == "recording"; }));
  EXPECT_TRUE(browser->becomes(button("record-start") + ".disabled"));
  // What cannot be undone asks before.
  browser->evaluate("window.asked = 0; window.confirm = () => { ++window.asked; return false; }");
  browser->evaluate(button("reset") + ".click()");
  EXPECT_EQ(browser->evaluate("window.asked"), 1);
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
}

// Of a real daemon: only while somebody looks, with what was found in the same frame.
TEST_F(ViewTest, TheLiveImageStandsUnderWhatWasFoundInIt) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(400, 300, false);  // a small map leaves the daemon some of the processor
  start(configuration());
  view();
  EXPECT_EQ(counter("preview.sent"), 0) << "nobody looks";
  browser->open(address());
  const std::string image = "document.getElementById('image')";
  EXPECT_TRUE(browser->becomes("Number(" + image + ".dataset.image) > 0", 60));
  // Light paper: there is more in it than markers alone.
  EXPECT_TRUE(browser->becomes(
      "(() => { const p = " + image + ".getContext('2d').getImageData(0, 0, " + image + ".width, " +
      image +
      ".height).data; let n = 0; for (let i = 0; i < p.length; i += 4) "
      "if (p[i + 3] === 255 && p[i] > 60) ++n; return n > 0.5 * p.length / 4; })()"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('image-text').textContent.includes("
                       "'residual in pixels')"));
  EXPECT_TRUE(eventually([&] { return counter("preview.sent") >= 5; }));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
}

// What is over: results of a run with the truth, and a recording of a daemon.
TEST_F(ViewTest, ResultsAndRecordingsAreShownWithATimeLine) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(500, 400, false);
  const std::string scene = (directory_ / "walls").string();
  const std::string result = (directory_ / "result").string();
  ASSERT_EQ(runProgram({WAYMARK_PROGRAM, "simulate", "walls", "--out", scene, "--duration", "2",
                        "--fps", "15", "--size", "320x240", "--quiet"})
                .exit_code,
            0);
  ASSERT_EQ(runProgram({WAYMARK_PROGRAM, "run", scene + "/frames.avi", "--calibration",
                        scene + "/calib.yml", "--dictionary", "ARUCO_MIP_36h12", "--marker-size",
                        "0.123", "--out", result, "--quiet"})
                .exit_code,
            0);
  view({result, "--truth", scene + "/gt_traj.txt"});
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().tracks === 3"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 10"));
  EXPECT_TRUE(browser->becomes(
      "document.getElementById('offline-errors').textContent.includes('ATE, live')"));
  EXPECT_EQ(browser->evaluate("document.getElementById('buttons').offsetParent"), nullptr)
      << "there is no daemon to tell anything";
  // The pose that is shown is the one of the time.
  const std::string time = "document.getElementById('time')";
  const std::string position = "document.getElementById('pose').textContent";
  EXPECT_TRUE(browser->becomes(position + ".includes('0.000  0.000')"));
  browser->evaluate(time + ".value = 1.5; " + time + ".dispatchEvent(new Event('input'))");
  EXPECT_TRUE(browser->becomes(position + ".includes('Frame22')"));
  browser->press(" ");
  EXPECT_TRUE(browser->becomes("WaymarkOffline.time() > 1.8"));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
  view_->signal(SIGTERM);
  EXPECT_EQ(view_->wait(milliseconds(5000)), 0);

  start(configuration("", "[record]\ndirectory = 'logs'\n"));
  std::this_thread::sleep_for(milliseconds(3000));
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0);
  const fs::path log = *fs::directory_iterator(directory_ / "logs");
  port_ = 0;
  view({log.string()});
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().segments > 20"));
  EXPECT_TRUE(browser->becomes("Number(document.getElementById('image').dataset.image) > 0"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 2"));
  browser->evaluate(time + ".value = 1; " + time + ".dispatchEvent(new Event('change'))");
  browser->evaluate("document.getElementById('play').click()");
  EXPECT_TRUE(browser->becomes("WaymarkOffline.time() > 0.9"));
  for (const std::string& error : browser->errors()) {
    EXPECT_NE(error.find("ERR_CONNECTION_REFUSED"), std::string::npos)
        << "while there was none that served: " << error;
  }
}

TEST_F(ViewTest, CommandsOfAPageReachTheDaemon) {
  start(configuration());
  view({"--allow-control"});
  boost::asio::io_context io;
  const auto socket = look(io);
  const auto answerTo = [&](const std::string& command) {
    socket->write(boost::asio::buffer(command));
    for (;;) {
      beast::flat_buffer buffer;
      socket->read(buffer);
      json message = json::parse(beast::buffers_to_string(buffer.data()));
      if (message["type"] == "answer") return message;
    }
  };
  const json saved = answerTo(R"({"command":"save-map"})");
  EXPECT_EQ(saved["ok"], true) << saved;
  EXPECT_TRUE(fs::exists(map_));
  EXPECT_EQ(answerTo(R"({"command":"reset"})")["ok"], true);
  EXPECT_TRUE(reaches("map.resets", 1));
  EXPECT_EQ(answerTo(R"({"command":"record-start"})")["error"],
            "record.directory is not configured");
  EXPECT_EQ(answerTo(R"({"command":"load-map","file":"/etc/passwd"})")["ok"], false);
  EXPECT_EQ(answerTo("nonsense")["ok"], false);
}

TEST_F(ViewTest, ProgramsReadStateAndMetrics) {
  view();
  const PretendedDaemon daemon(url_, "TEST_");
  const auto told = [&](const char* what) {
    return get("/metrics").find(what) != std::string::npos;
  };
  EXPECT_TRUE(eventually([&] { return told("waymark_up 1\n"); }));
  EXPECT_TRUE(eventually([&] { return told("waymark_map_markers 48\n"); })) << "comes again";
  const std::string metrics = get("/metrics");
  EXPECT_TRUE(metrics.starts_with("HTTP/1.1 200 OK\r\n"));
  EXPECT_NE(metrics.find("waymark_map_markers 48\n"), std::string::npos) << metrics;
  EXPECT_NE(metrics.find("waymark_status{status=\"tracking\"} 1\n"), std::string::npos);
  const std::string state = get("/state.json");
  const json parsed = json::parse(state.substr(state.find("\r\n\r\n") + 4));
  EXPECT_EQ(parsed["map"]["markers"].size(), 48U);
  EXPECT_EQ(parsed["pose"]["status"], "tracking");
}

TEST_F(ViewTest, StrangersGetNothing) {
  view();
  EXPECT_TRUE(raw("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").starts_with("HTTP/1.1 421 "));
  EXPECT_TRUE(get("/../../etc/passwd").starts_with("HTTP/1.1 404 "));
  EXPECT_TRUE(get("/ws").starts_with("HTTP/1.1 426 "));
  const std::string upgrade =
      "Upgrade: websocket\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
      "Sec-WebSocket-Version: 13\r\nConnection: Upgrade\r\n";
  EXPECT_TRUE(raw("GET /ws HTTP/1.1\r\nHost: 127.0.0.1:1\r\nOrigin: http://evil.example\r\n" +
                  upgrade + "\r\n")
                  .starts_with("HTTP/1.1 403 "));
  const std::string page = get("/");
  EXPECT_NE(page.find("Content-Security-Policy: default-src 'none'; script-src 'self'"),
            std::string::npos);
  EXPECT_NE(page.find("X-Content-Type-Options: nosniff"), std::string::npos);
  // Too long, half a request, and noise: let go, and served on.
  (void)raw("GET /" + std::string(100'000, 'a') + " HTTP/1.1\r\n\r\n");
  (void)raw("GET / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n");
  (void)raw(std::string("\x16\x03\x01\x00\xff\x00", 6) + std::string(5000, '\xff'));
  EXPECT_TRUE(get("/").starts_with("HTTP/1.1 200 OK"));
}

TEST_F(ViewTest, ItOnlyLooksUnlessAllowed) {
  view();
  boost::asio::io_context io;
  const auto socket = look(io);
  socket->write(boost::asio::buffer(std::string(R"({"command":"reset"})")));
  for (;;) {
    beast::flat_buffer buffer;
    socket->read(buffer);
    const json message = json::parse(beast::buffers_to_string(buffer.data()));
    if (message["type"] == "hello") {
      EXPECT_EQ(message["control"], false);
    }
    if (message["type"] != "answer") continue;
    EXPECT_EQ(message["ok"], false);
    EXPECT_EQ(message["error"], "this view only looks: --allow-control");
    break;
  }
}

TEST_F(ViewTest, OthersNeedTheToken) {
  const std::string token = "abcdefghijklmnop0123";
  std::ofstream(directory_ / "token") << token << "\n";
  const auto refused = [&](std::vector<std::string> options, const std::string& why) {
    options.insert(options.begin(), {WAYMARK_VIEW, "--port", "0", "--page", WAYMARK_VIEW_PAGE,
                                     "--health", WAYMARK_HEALTH_MD});
    const ProgramResult result = runProgram(options);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.err.find(why), std::string::npos) << result.err;
  };
  refused({"--listen", "0.0.0.0"}, "--listen 0.0.0.0: others could look: --token-file FILE");
  refused({"--listen", "here"}, "'here' is no address");
  std::ofstream(directory_ / "short") << "abc\n";
  refused({"--token-file", directory_ / "short"}, "short: must be one line of 16 to 200 letters");
  view({"--token-file", directory_ / "token"});
  EXPECT_TRUE(get("/").starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(get("/state.json").starts_with("HTTP/1.1 401 "));
  EXPECT_TRUE(get("/state.json?token=" + token).starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(
      get("/metrics", "Authorization: Bearer " + token + "\r\n").starts_with("HTTP/1.1 200 "));
}

// Sixteen that read, one that does not, and as many as there are places.
TEST_F(ViewTest, APageThatSaysWhenItIsReadyGetsNoMoreBeforeThat) {
  view();
  const PretendedDaemon daemon(url_, "TEST_");
  boost::asio::io_context io;
  const auto socket = look(io);
  const auto readable = [&] {
    pollfd waiting{socket->next_layer().native_handle(), POLLIN, 0};
    return poll(&waiting, 1, 500) > 0;
  };
  const auto readAll = [&] {
    int messages = 0;
    while (readable()) {
      beast::flat_buffer buffer;
      socket->read(buffer);
      if (++messages > 100) break;
    }
    return messages;
  };
  const std::string more = R"({"command":"more"})";
  socket->write(boost::asio::buffer(more));
  const int first = readAll();
  socket->write(boost::asio::buffer(more));
  const int second = readAll();
  EXPECT_GE(second, 1);
  // What greets it, all parts, and two rounds of at most eight; without rounds it would be thirty
  // poses a second and more.
  EXPECT_LE(first + second, 2 + 8 + 8 + 8);
}

TEST_F(ViewTest, ASlowClientCostsItselfOnly) {
  view();
  const PretendedDaemon daemon(url_, "TEST_", 150.0);
  boost::asio::io_context io;
  const auto slow = look(io);  // and never reads
  std::vector<std::unique_ptr<Socket>> many;
  for (int i = 0; i < 31; ++i) many.push_back(look(io));
  EXPECT_TRUE(raw("GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\n"
                  "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                  "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n")
                  .starts_with("HTTP/1.1 503 "))
      << "all places are taken";
  // Each of those that read sees the frames of now.
  for (int round = 0; round < 20; ++round) {
    std::this_thread::sleep_for(milliseconds(50));
    for (std::size_t i = 0; i < 16; ++i) {
      beast::flat_buffer buffer;
      many[i]->read(buffer);
      EXPECT_TRUE(json::accept(beast::buffers_to_string(buffer.data())));
    }
  }
  EXPECT_TRUE(get("/metrics").find("waymark_up 1\n") != std::string::npos);
}

}  // namespace
}  // namespace waymark::testing
