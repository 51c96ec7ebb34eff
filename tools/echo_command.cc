#include "tools/echo_command.h"

#include <cinttypes>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>

#include <CLI/CLI.hpp>
#include <lcm/lcm.h>

#include "daemon/clock.h"
#include "daemon/configuration.h"
#include "daemon/lcm_link.h"
#include "daemon/stop_signal.h"
#include "tools/exit_code.h"
#include "tools/pose_stream.h"
#include <waymark/pose_t.hpp>

namespace waymark::tools {
namespace {

struct EchoOptions {
  std::string url = daemon::Configuration::Publish{}.url;
  std::string channel_prefix = daemon::Configuration::Publish{}.channel_prefix;
  bool tum = false;
  bool stats = false;
  bool quiet = false;
  std::int64_t count = 0;   // messages; 0: no limit
  double duration_s = 0.0;  // 0: no limit
};

const char* statusWord(std::int8_t status) {
  switch (status) {
    case pose_t::STATUS_INITIALIZING:
      return "initializing";
    case pose_t::STATUS_TRACKING:
      return "tracking";
    case pose_t::STATUS_RELOCALIZING:
      return "relocalizing";
    case pose_t::STATUS_NO_CAMERA:
      return "no camera";
    default:
      return "unknown";
  }
}

void printTum(const pose_t& m) {
  if (m.source == pose_t::SOURCE_NONE) return;
  std::printf("%" PRId64 ".%06" PRId64 " %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", m.utime / 1'000'000,
              m.utime % 1'000'000, m.p_w_c[0], m.p_w_c[1], m.p_w_c[2], m.q_w_c[1], m.q_w_c[2],
              m.q_w_c[3], m.q_w_c[0]);
}

void printLine(const pose_t& m) {
  std::printf("%8" PRId64 "  %-12s  ", m.sequence, statusWord(m.status));
  if (m.source == pose_t::SOURCE_NONE) {
    std::printf("no pose: %s", m.reason.c_str());
    if (m.had_pose) std::printf("; the last one is %.1f s old", 1e-9 * m.last_pose_age_ns);
    std::printf("\n");
    return;
  }
  std::printf("p %8.4f %8.4f %8.4f m  q %7.4f %7.4f %7.4f %7.4f  %2d markers  %.3f px  %.2f ms\n",
              m.p_w_c[0], m.p_w_c[1], m.p_w_c[2], m.q_w_c[0], m.q_w_c[1], m.q_w_c[2], m.q_w_c[3],
              m.markers_used, m.reprojection_rms_px, 1e-6 * static_cast<double>(m.latency_ns));
}

class Echo {
 public:
  explicit Echo(const EchoOptions& options) : options_(options) {}

  int run();

 private:
  static void onMessage(const lcm_recv_buf_t* buffer, const char* /*channel*/, void* self) {
    static_cast<Echo*>(self)->receive(*buffer);
  }
  void receive(const lcm_recv_buf_t& buffer);
  [[nodiscard]] bool over(std::int64_t begin_ns) const;

  const EchoOptions& options_;
  PoseStream stream_;
  pose_t pose_{};
};

int fail(const std::string& reason) {
  std::fprintf(stderr, "waymark echo: %s\n", reason.c_str());
  return kBadInput;
}

int Echo::run() {
  const auto address = daemon::multicastAddress(options_.url);
  if (!address) return fail("--url: not a multicast address: " + options_.url);
  // LCM itself would say so in a dozen lines.
  if (!daemon::hasRoute(*address)) return fail(options_.url + ": there is no multicast route");

  daemon::StopSignal stop;
  const std::unique_ptr<lcm_t, void (*)(lcm_t*)> lcm(lcm_create(options_.url.c_str()), lcm_destroy);
  if (!lcm) return fail(options_.url + ": LCM refuses it");
  const std::string channel = options_.channel_prefix + "POSE";
  lcm_subscription_t* subscription = lcm_subscribe(lcm.get(), channel.c_str(), &onMessage, this);
  if (subscription == nullptr) return fail(channel + ": cannot subscribe");
  lcm_subscription_set_queue_capacity(subscription, 1000);  // seconds, should the terminal stall

  const std::int64_t begin_ns = daemon::monotonicNs();
  while (!stop.pending() && !over(begin_ns)) {
    if (lcm_handle_timeout(lcm.get(), 20) < 0) return fail(options_.url + ": receiving failed");
  }
  if (options_.stats) std::printf("%s", stream_.summary(options_.tum ? "# " : "").c_str());
  return stream_.localized() > 0 ? kDone : kNoPose;
}

bool Echo::over(std::int64_t begin_ns) const {
  const double elapsed_s = 1e-9 * static_cast<double>(daemon::monotonicNs() - begin_ns);
  return (options_.count > 0 && stream_.messages() >= options_.count) ||
         (options_.duration_s > 0.0 && elapsed_s >= options_.duration_s);
}

void Echo::receive(const lcm_recv_buf_t& buffer) {
  const std::int64_t now_ns = daemon::monotonicNs();
  try {
    // Anybody can send on a channel; the generated code throws on impossible lengths.
    if (pose_.decode(buffer.data, 0, static_cast<int>(buffer.data_size)) < 0) {
      return stream_.addMalformed();
    }
  } catch (const std::exception&) {
    return stream_.addMalformed();
  }
  stream_.add(pose_, now_ns);
  if (options_.quiet) return;
  if (options_.tum) {
    printTum(pose_);
  } else {
    printLine(pose_);
  }
}

}  // namespace

void addEchoCommand(CLI::App& app, int* exit_code) {
  auto options = std::make_shared<EchoOptions>();
  CLI::App* echo = app.add_subcommand("echo", "Print the poses that a running daemon publishes");
  echo->add_flag("--tum", options->tum, "Print poses as TUM lines: seconds, position, quaternion");
  echo->add_flag("--stats", options->stats, "At the end: messages, gaps, rate, latencies");
  echo->add_flag("--quiet", options->quiet, "No line for each message");
  echo->add_option("--url", options->url, "LCM URL")->capture_default_str();
  echo->add_option("--channel-prefix", options->channel_prefix, "Channels begin with this")
      ->capture_default_str();
  echo->add_option("--count", options->count, "Stop after so many messages")
      ->check(CLI::PositiveNumber);
  echo->add_option("--duration", options->duration_s, "Stop after so many seconds")
      ->check(CLI::PositiveNumber);
  echo->callback([options, exit_code] {
    std::setvbuf(stdout, nullptr, _IOLBF, 0);  // whole lines also into a pipe
    *exit_code = Echo(*options).run();
  });
}

}  // namespace waymark::tools
