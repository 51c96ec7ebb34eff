#include "tools/echo_command.h"

#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <exception>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>
#include <lcm/lcm.h>

#include "base/clock.h"
#include "daemon/configuration.h"
#include "daemon/control/stop_signal.h"
#include "daemon/health/status_name.h"
#include "daemon/publish/lcm_link.h"
#include "io/maps/map_file.h"
#include "io/maps/map_picture.h"
#include "io/text/json_node.h"
#include "io/trajectory.h"
#include "slam/geometry/transform.h"
#include "tools/exit_code.h"
#include "tools/maps/live_map.h"
#include "tools/number_arguments.h"
#include "tools/pose_stream.h"
#include <waymark/health_t.hpp>
#include <waymark/joint_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/natural_map_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::tools {
namespace {

constexpr std::int64_t kSilence_ns = 2'000'000'000;

struct EchoOptions {
  std::string url = daemon::Configuration::Publish{}.url;
  std::string channel_prefix = daemon::Configuration::Publish{}.channel_prefix;
  bool tum = false;
  bool json = false;
  bool from_start = false;
  bool sigma = false;
  bool stats = false;
  bool quiet = false;
  double interval_s = 0.0;  // between lines; 0: every message
  std::int64_t count = 0;   // messages; 0: no limit
  double duration_s = 0.0;  // 0: no limit
  std::string map_file;     // empty: none
  std::string picture_file;
};

// Times count from `start_utime`.
void printTum(const pose_t& m, std::int64_t start_utime) {
  if (m.source == pose_t::SOURCE_NONE) return;
  const std::int64_t t_us = m.utime - start_utime;
  std::printf("%" PRId64 ".%06" PRId64 " %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", t_us / 1'000'000,
              t_us % 1'000'000, m.p_w_c[0], m.p_w_c[1], m.p_w_c[2], m.q_w_c[1], m.q_w_c[2],
              m.q_w_c[3], m.q_w_c[0]);
}

// Standard deviation of where the camera is, mm, and of where it looks, degrees: along the axes
// that are known worst.
void printSigma(const char* of_what, const double (&covariance)[36]) {
  const double position = std::max({covariance[0], covariance[7], covariance[14]});
  const double rotation = std::max({covariance[21], covariance[28], covariance[35]});
  std::printf("  %s +- %.2f mm %.3f deg", of_what, 1e3 * std::sqrt(position),
              180.0 / std::numbers::pi * std::sqrt(rotation));
}

// One object a line, the message by its field names.
void printJson(const pose_t& m) {
  io::Json json = {{"utime", m.utime},
                   {"monotonic_ns", m.monotonic_ns},
                   {"sequence", m.sequence},
                   {"status", daemon::statusName(m.status)},
                   {"reason", m.reason},
                   {"source", m.source},
                   {"had_pose", m.had_pose != 0},
                   {"last_pose_age_ns", m.last_pose_age_ns}};
  if (m.source != pose_t::SOURCE_NONE) {
    json["p_w_c"] = m.p_w_c;
    json["q_w_c"] = m.q_w_c;
    json["covariance"] = m.covariance;
    json["view_covariance"] = m.view_covariance;
    json["markers_used"] = m.markers_used;
    json["reprojection_rms_px"] = m.reprojection_rms_px;
    json["ambiguity_ratio"] = m.ambiguity_ratio;
  }
  json["map_piece"] = m.map_piece;
  json["latency_ns"] = m.latency_ns;
  // Text from the network need not be UTF-8.
  std::printf("%s\n", json.dump(-1, ' ', false, io::Json::error_handler_t::replace).c_str());
}

void printLine(const pose_t& m, bool with_sigma) {
  std::printf("%8" PRId64 "  %-12s  ", m.sequence, daemon::statusName(m.status).c_str());
  if (m.source == pose_t::SOURCE_NONE) {
    std::printf("no pose: %s", m.reason.c_str());
    if (m.had_pose) std::printf("; the last one is %.1f s old", 1e-9 * m.last_pose_age_ns);
    std::printf("\n");
    return;
  }
  std::printf("p %8.4f %8.4f %8.4f m  q %7.4f %7.4f %7.4f %7.4f  %2d markers  %.3f px  %.2f ms",
              m.p_w_c[0], m.p_w_c[1], m.p_w_c[2], m.q_w_c[0], m.q_w_c[1], m.q_w_c[2], m.q_w_c[3],
              m.markers_used, m.reprojection_rms_px, 1e-6 * static_cast<double>(m.latency_ns));
  if (m.map_piece != 0) std::printf("  piece %d", m.map_piece);
  if (with_sigma) {
    printSigma("world", m.covariance);
    printSigma("view", m.view_covariance);
  }
  std::printf("\n");
}

// Anybody can send on a channel, and the generated code throws on impossible lengths.
template <typename Message>
bool decode(const lcm_recv_buf_t& buffer, Message* message) {
  try {
    return message->decode(buffer.data, 0, static_cast<int>(buffer.data_size)) >= 0;
  } catch (const std::exception&) {
    return false;
  }
}

class Echo {
 public:
  explicit Echo(const EchoOptions& options) : options_(options) {}

  Result<ExitCode> run();

 private:
  using LcmPtr = std::unique_ptr<lcm_t, void (*)(lcm_t*)>;

  Status subscribe(lcm_t* lcm, const char* channel, lcm_msg_handler_t handler);
  void receivePose(const lcm_recv_buf_t& buffer);
  void receiveMap(const lcm_recv_buf_t& buffer);
  void receiveNaturalMap(const lcm_recv_buf_t& buffer);
  void receiveJoint(const lcm_recv_buf_t& buffer);
  void receiveHealth(const lcm_recv_buf_t& buffer);
  void print();
  void tellSilence() const;
  [[nodiscard]] bool over(std::int64_t begin_ns) const;
  [[nodiscard]] Status writeFiles() const;
  [[nodiscard]] io::MapPicture picture(int first_piece) const;

  const EchoOptions& options_;
  PoseStream stream_;
  LiveMap map_;
  std::map<int, io::Trajectory> trajectories_;  // for the picture, by piece of the map
  pose_t pose_{};
  map_t map_piece_{};
  natural_map_t natural_map_{};
  health_t health_{};
  joint_t joint_{};
  std::optional<std::int64_t> first_utime_;  // of the first frame received
  std::int64_t next_line_ns_ = 0;            // monotonic
  int tum_piece_ = 0;                        // of the last line of --tum
};

Result<ExitCode> Echo::run() {
  const auto address = daemon::multicastAddress(options_.url);
  if (!address) return Error{"--url: not a multicast address: " + options_.url};
  // LCM itself would say so in a dozen lines.
  if (!daemon::hasRoute(*address)) return Error{options_.url + ": there is no multicast route"};

  daemon::StopSignal stop;
  const LcmPtr lcm(lcm_create(options_.url.c_str()), lcm_destroy);
  if (!lcm) return Error{options_.url + ": LCM refuses it"};
  const Status poses =
      subscribe(lcm.get(), "POSE", [](const auto* buffer, const char*, void* self) {
        static_cast<Echo*>(self)->receivePose(*buffer);
      });
  if (!poses) return poses.error();
  if (!options_.quiet && !options_.tum && !options_.json) {
    const Status joints =
        subscribe(lcm.get(), "JOINT", [](const auto* buffer, const char*, void* self) {
          static_cast<Echo*>(self)->receiveJoint(*buffer);
        });
    if (!joints) return joints.error();
  }
  if (options_.stats) {
    const Status healths =
        subscribe(lcm.get(), "HEALTH", [](const auto* buffer, const char*, void* self) {
          static_cast<Echo*>(self)->receiveHealth(*buffer);
        });
    if (!healths) return healths.error();
  }
  if (!options_.map_file.empty() || !options_.picture_file.empty()) {
    const Status maps =
        subscribe(lcm.get(), "MAP", [](const auto* buffer, const char*, void* self) {
          static_cast<Echo*>(self)->receiveMap(*buffer);
        });
    if (!maps) return maps.error();
  }
  if (!options_.picture_file.empty()) {
    const Status maps =
        subscribe(lcm.get(), "NATURAL_MAP", [](const auto* buffer, const char*, void* self) {
          static_cast<Echo*>(self)->receiveNaturalMap(*buffer);
        });
    if (!maps) return maps.error();
  }

  const std::int64_t begin_ns = monotonicNs();
  bool told = false;
  while (!stop.pending() && !over(begin_ns)) {
    if (!told && stream_.messages() == 0 && monotonicNs() - begin_ns > kSilence_ns) {
      told = true;
      tellSilence();
    }
    if (lcm_handle_timeout(lcm.get(), 20) < 0) {
      return Error{options_.url + ": receiving failed"};
    }
  }
  if (options_.stats) std::printf("%s", stream_.summary(options_.tum ? "# " : "").c_str());
  if (const Status written = writeFiles(); !written) return written.error();
  return stream_.localized() > 0 ? kDone : kNoPose;
}

// A daemon sends something every second, also without a camera.
void Echo::tellSilence() const {
  std::fprintf(stderr,
               "waymark echo: nothing on %sPOSE at %s for two seconds: is waymarkd running, with "
               "this URL and prefix (publish.url, publish.channel_prefix)? Waiting on\n",
               options_.channel_prefix.c_str(), options_.url.c_str());
}

Status Echo::subscribe(lcm_t* lcm, const char* name, lcm_msg_handler_t handler) {
  const std::string channel = options_.channel_prefix + name;
  lcm_subscription_t* subscription = lcm_subscribe(lcm, channel.c_str(), handler, this);
  if (subscription == nullptr) return Error{channel + ": cannot subscribe"};
  lcm_subscription_set_queue_capacity(subscription, 1000);  // seconds, should the terminal stall
  return success();
}

bool Echo::over(std::int64_t begin_ns) const {
  const double elapsed_s = 1e-9 * static_cast<double>(monotonicNs() - begin_ns);
  return (options_.count > 0 && stream_.messages() >= options_.count) ||
         (options_.duration_s > 0.0 && elapsed_s >= options_.duration_s);
}

void Echo::receivePose(const lcm_recv_buf_t& buffer) {
  const std::int64_t now_ns = monotonicNs();
  if (!decode(buffer, &pose_)) return stream_.addMalformed();
  stream_.add(pose_, now_ns);
  if (!first_utime_ && pose_.status != pose_t::STATUS_NO_CAMERA) first_utime_ = pose_.utime;
  if (!options_.picture_file.empty() && pose_.source != pose_t::SOURCE_NONE) {
    const Eigen::Quaterniond q(pose_.q_w_c[0], pose_.q_w_c[1], pose_.q_w_c[2], pose_.q_w_c[3]);
    trajectories_[pose_.map_piece].push_back(
        {1000 * pose_.utime, slam::Transform::fromQuaternion(q, Eigen::Vector3d(pose_.p_w_c))});
  }
  if (options_.quiet || now_ns < next_line_ns_) return;
  next_line_ns_ = now_ns + static_cast<std::int64_t>(1e9 * options_.interval_s);
  print();
}

void Echo::receiveMap(const lcm_recv_buf_t& buffer) {
  if (!decode(buffer, &map_piece_) || !map_.add(map_piece_)) stream_.addMalformed();
}

void Echo::receiveNaturalMap(const lcm_recv_buf_t& buffer) {
  if (!decode(buffer, &natural_map_) || !map_.add(natural_map_)) stream_.addMalformed();
}

void Echo::receiveJoint(const lcm_recv_buf_t& buffer) {
  if (!decode(buffer, &joint_)) return stream_.addMalformed();
  const bool joined = joint_.kind == joint_t::KIND_JOINED;
  std::printf("%8" PRId64 "  piece %d of the map %s piece %d\n", joint_.sequence, joint_.map_piece,
              joined ? "is part of" : "is no part any more of", joint_.into);
}

void Echo::receiveHealth(const lcm_recv_buf_t& buffer) {
  if (!decode(buffer, &health_)) return stream_.addMalformed();
  stream_.add(health_);
}

void Echo::print() {
  if (options_.json) {
    printJson(pose_);
  } else if (options_.tum) {
    if (pose_.source != pose_t::SOURCE_NONE && pose_.map_piece != tum_piece_) {
      tum_piece_ = pose_.map_piece;
      std::printf("# piece %d of the map, a world of its own\n", tum_piece_);
    }
    printTum(pose_, options_.from_start ? first_utime_.value_or(0) : 0);
  } else {
    printLine(pose_, options_.sigma);
  }
}

// A list of markers is of one world: the one that the camera is in at the end.
Status Echo::writeFiles() const {
  const int piece = pose_.map_piece;
  if (const std::size_t worlds = map_.worlds().size(); worlds > 1 && !options_.map_file.empty()) {
    std::fprintf(stderr,
                 "waymark: the map has %zu pieces, each with a world of its own; %s is of piece "
                 "%d\n",
                 worlds, options_.map_file.c_str(), piece);
  }
  if (!options_.map_file.empty()) {
    Status written =
        io::writeMarkerLayout(options_.map_file, map_.markers(piece), "the map as published");
    if (!written) return written;
  }
  if (options_.picture_file.empty()) return success();
  return io::writeMapPicture(options_.picture_file, picture(piece));
}

// All pieces, that one first.
io::MapPicture Echo::picture(int first_piece) const {
  io::MapPicture picture{.title = "Map and trajectory as published", .pieces = {}};
  const auto add = [&](int piece) {
    const auto found = trajectories_.find(piece);
    picture.pieces.push_back(
        {.piece = piece,
         .markers = map_.markers(piece),
         .natural = map_.natural(piece),
         .estimate = found == trajectories_.end() ? io::Trajectory() : found->second});
  };
  add(first_piece);
  for (const int piece : map_.worlds()) {
    if (piece != first_piece) add(piece);
  }
  return picture;
}

}  // namespace

void addEchoCommand(CLI::App& app, int* exit_code) {
  auto options = std::make_shared<EchoOptions>();
  CLI::App* echo = app.add_subcommand("echo", "Print the poses that a running daemon publishes");
  echo->add_flag("--tum", options->tum, "Print poses as TUM lines: seconds, position, quaternion");
  echo->add_flag("--json", options->json, "Print poses as JSON, one object a line")
      ->excludes("--tum");
  echo->add_flag("--from-start", options->from_start,
                 "Times of --tum count from the first frame received, not from 1970");
  echo->add_flag("--sigma", options->sigma,
                 "Also how well each pose is known: in the world, and relative to the markers in "
                 "view; standard deviations along the worst axes");
  echo->add_flag("--stats", options->stats, "At the end: messages, gaps, rate, latencies");
  echo->add_flag("--quiet", options->quiet, "No line for each message");
  echo->add_option("--interval", options->interval_s,
                   "At most one line in so many seconds; all messages count nevertheless")
      ->check(numberFrom(0.0, 1e9));
  echo->add_option("--map", options->map_file,
                   "At the end: write the last map into this JSON file");
  echo->add_option("--picture", options->picture_file,
                   "At the end: draw the last map and all poses into this SVG file");
  echo->add_option("--url", options->url, "LCM URL")->capture_default_str();
  echo->add_option("--channel-prefix", options->channel_prefix, "Channels begin with this")
      ->capture_default_str();
  echo->add_option("--count", options->count, "Stop after so many messages")->check(count());
  echo->add_option("--duration", options->duration_s, "Stop after so many seconds")
      ->check(duration());
  echo->callback([options, exit_code] {
    std::setvbuf(stdout, nullptr, _IOLBF, 0);  // whole lines also into a pipe
    const Result<ExitCode> result = Echo(*options).run();
    if (!result) std::fprintf(stderr, "waymark echo: %s\n", result.error().message.c_str());
    *exit_code = result ? result.value() : kBadInput;
  });
}

}  // namespace waymark::tools
