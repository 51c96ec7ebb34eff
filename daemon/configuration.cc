#include "daemon/configuration.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "capture/open_source.h"
#include "capture/recorded_file.h"
#include "daemon/publish/lcm_link.h"
#include "io/settings/marker_ids.h"
#include "io/settings/pose_settings.h"
#include "io/settings/settings_file.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

io::ValidationError validateUrl(const std::string& url) {
  if (!multicastAddress(url)) {
    return "must be like \"udpm://239.255.76.67:7667?ttl=0\" with a multicast address, not \"" +
           url + "\"";
  }
  return wrongUrlOption(url);
}

// LCM allows 63 characters for a channel; the longest name after the prefix is "NATURAL_MAP".
io::ValidationError validateChannel(const std::string& name) {
  constexpr std::size_t kMax = 50;
  const auto plain = [](unsigned char c) { return c > ' ' && c < 127; };
  if (name.size() <= kMax && std::ranges::all_of(name, plain)) return {};
  return "must be at most 50 characters without spaces";
}

// "0, 2-3"
io::Setting cpusSetting(const std::string& key, std::vector<int>& target) {
  return io::checkedTextSetting(key, [&target](const std::string& text) -> io::ValidationError {
    constexpr int kMax = 1023;  // as many as a cpu_set_t has
    const auto ranges = io::parseIdRanges(text);
    if (!ranges) return ranges.error().message;
    for (const slam::IdRange& range : *ranges) {
      if (range.last > kMax) return "must be processors from 0 to " + std::to_string(kMax);
      for (int cpu = range.first; cpu <= range.last; ++cpu) target.push_back(cpu);
      if (std::ssize(target) > kMax + 1) return "must name each processor once";
    }
    return {};
  });
}

io::Setting noting(bool& given, io::Setting setting) {
  setting.read = [&given, read = std::move(setting.read)](const io::SettingValue& value) {
    given = true;
    return read(value);
  };
  return setting;
}

// One [[natural]].
std::vector<io::Setting> naturalKeys(Configuration::NaturalMarker& marker) {
  using namespace io;
  return {required(textSetting("name", marker.name)),
          required(pathSetting("image", marker.image)),
          required(numberSetting("width_m", marker.width_m, 1e-3, 100.0, "m")),
          numberSetting("height_m", marker.height_m, 1e-3, 100.0, "m"),
          noting(marker.has_position, positionSetting("p_m", marker.T_w_m)),
          noting(marker.has_orientation, orientationSetting("q_wxyz", marker.T_w_m))};
}

}  // namespace

std::vector<io::Setting> configurationKeys(Configuration& c) {
  using namespace io;
  constexpr std::int64_t kMaxSeed = std::numeric_limits<std::int64_t>::max();
  Configuration::Simulator& simulator = c.camera.simulator;
  std::vector<Setting> all = {
      required(textSetting("camera.source", c.camera.source)),
      pathSetting("camera.calibration", c.camera.calibration),
      choiceSetting<slam::CalibrationFit>("camera.calibration_fit", c.camera.calibration_fit,
                                          {{"exact", slam::CalibrationFit::kExact},
                                           {"scale", slam::CalibrationFit::kScale},
                                           {"crop", slam::CalibrationFit::kCrop}}),
      numberSetting("camera.rate_hz", c.camera.rate_hz, 0.1, 1000.0, "Hz"),
      textSetting("camera.format", c.camera.device.format),
      integerSetting("camera.width", c.camera.device.width, 16, 16384),
      integerSetting("camera.height", c.camera.device.height, 16, 16384),
      integerSetting("camera.buffers", c.camera.device.buffers, 3, 32),
      numberSetting("camera.exposure_s", c.camera.device.exposure_s, 1e-6, 10.0, "s"),
      freeSection("camera.controls", c.camera.device.controls),
      integerSetting("camera.simulator.seed", simulator.seed, 0, kMaxSeed),
      integerSetting("camera.simulator.width", simulator.width, 64, 4096),
      integerSetting("camera.simulator.height", simulator.height, 64, 4096),
      numberSetting("camera.simulator.loop_s", simulator.loop_s, 0.1, 120.0, "s"),
      pathSetting("camera.simulator.truth_dir", simulator.truth_dir),
      positionSetting("body.p_m", c.body.T_b_c),
      orientationSetting("body.q_wxyz", c.body.T_b_c),
      sectionsSetting<Configuration::NaturalMarker>("natural", c.natural, naturalKeys),
      pathSetting("relocalizer.markers", c.relocalizer.markers),
      numberSetting("relocalizer.core_share", c.relocalizer.core_share, 0.01, 1.0, ""),
      integerSetting("queue.depth", c.queue.depth, 1, 64),
      integerSetting("realtime.capture_priority", c.realtime.capture.priority, 0, 99),
      integerSetting("realtime.slam_priority", c.realtime.slam.priority, 0, 99),
      integerSetting("realtime.publisher_priority", c.realtime.publisher.priority, 0, 99),
      integerSetting("realtime.recorder_priority", c.realtime.recorder.priority, 0, 99),
      cpusSetting("realtime.capture_cpus", c.realtime.capture.cpus),
      cpusSetting("realtime.slam_cpus", c.realtime.slam.cpus),
      cpusSetting("realtime.publisher_cpus", c.realtime.publisher.cpus),
      cpusSetting("realtime.recorder_cpus", c.realtime.recorder.cpus),
      flagSetting("realtime.lock_memory", c.realtime.lock_memory),
      textSetting("publish.url", c.publish.url, validateUrl),
      textSetting("publish.channel_prefix", c.publish.channel_prefix, validateChannel),
      textSetting("publish.pose_channel", c.publish.pose_channel, validateChannel),
      flagSetting("publish.detections", c.publish.detections),
      numberSetting("publish.map_interval_s", c.publish.map_interval_s, 0.1, 1e6, "s"),
      pathSetting("record.directory", c.record.directory),
      flagSetting("record.at_start", c.record.at_start),
      flagSetting("record.images", c.record.images),
      integerSetting("record.jpeg_quality", c.record.jpeg_quality, 0, 100),
      textSetting("record.image_channel", c.record.image_channel, validateChannel),
      integerSetting("record.file_mib", c.record.file_mib, 1, 1'000'000),
      integerSetting("record.file_s", c.record.file_s, 1, 1'000'000),
      integerSetting("record.quota_mib", c.record.quota_mib, 0, 100'000'000),
      integerSetting("record.keep_free_mib", c.record.keep_free_mib, 0, 100'000'000),
      integerSetting("record.flush_ms", c.record.flush_ms, 10, 60'000),
      integerSetting("record.buffer_mib", c.record.buffer_mib, 1, 4096),
      pathSetting("control.socket", c.control.socket),
      choiceSetting<LogLevel>("log.level", c.log.level,
                              {kLogLevelNames.begin(), kLogLevelNames.end()}),
  };
  std::ranges::move(slamSettingKeys(c.slam), std::back_inserter(all));
  return all;
}

namespace {

// Two kinds of messages on one channel: whoever listens gets what it cannot decode.
Status checkChannels(const Configuration& c, const fs::path& file) {
  const auto own = [&](const std::string& name) {
    return std::ranges::any_of(
        std::array{"POSE", "DETECTIONS", "MAP", "HEALTH", "NATURAL", "NATURAL_MAP"},
        [&](const char* of) { return name == c.publish.channel_prefix + of; });
  };
  const auto taken = [&](const char* key, const std::string& name) {
    return Error{file.string() + ": " + key + ": \"" + io::oneLine(name) +
                 "\" is another message's channel already"};
  };
  if (own(c.publish.pose_channel)) return taken("publish.pose_channel", c.publish.pose_channel);
  const std::string& images = c.record.image_channel;
  if (own(images) || images == c.publish.pose_channel ||
      images == capture::RecordedFile::kChannel) {
    return taken("record.image_channel", images);
  }
  return success();
}

Status checkNatural(const Configuration& c, const fs::path& file) {
  if (c.natural.empty() && c.relocalizer.markers.empty()) return success();
  if (!c.natural.empty() && !c.relocalizer.markers.empty()) {
    return Error{file.string() +
                 ": relocalizer.markers: [[natural]] has some already; one of the "
                 "two"};
  }
  if (!c.slam.options.natural.enabled) {
    return Error{file.string() + ": natural: needs slam.natural.enabled"};
  }
  for (const Configuration::NaturalMarker& marker : c.natural) {
    if (marker.has_position == marker.has_orientation) continue;
    return Error{file.string() + ": natural \"" + io::oneLine(marker.name) +
                 "\": p_m and q_wxyz go together"};
  }
  return success();
}

bool simulated(const Configuration& c) { return c.camera.source.starts_with("sim:"); }

}  // namespace

bool lensIsUnknown(const Configuration& c) { return !simulated(c) && c.camera.calibration.empty(); }

namespace {

// What no single key can say.
Status checkTogether(const Configuration& c, const fs::path& file) {
  if (lensIsUnknown(c) && !c.slam.options.lens.learn) {
    return Error{file.string() + ": camera.calibration: missing, and camera.learn is off"};
  }
  if (lensIsUnknown(c) && (!c.natural.empty() || !c.relocalizer.markers.empty())) {
    return Error{
        file.string() +
        ": camera.calibration: missing; natural markers are looked for through a known lens"};
  }
  if (lensIsUnknown(c) && capture::isCamera(c.camera.source) && c.camera.device.width == 0) {
    return Error{file.string() +
                 ": camera: width and height are missing, which no calibration says"};
  }
  if (simulated(c) && !c.camera.calibration.empty()) {
    return Error{file.string() + ": camera.calibration: simulated cameras bring their own"};
  }
  const capture::CameraOptions& device = c.camera.device;
  if (!capture::isCamera(c.camera.source) && device != capture::CameraOptions{}) {
    return Error{file.string() +
                 ": camera: format, width, height, buffers, exposure_s and controls are for "
                 "cameras, which \"" +
                 io::oneLine(c.camera.source) + "\" is not"};
  }
  if ((device.width == 0) != (device.height == 0)) {
    return Error{file.string() + ": camera: width and height go together"};
  }
  if (const std::string reason = c.slam.options.invalidReason(); !reason.empty()) {
    return Error{file.string() + ": slam: " + reason};
  }
  if (const std::string reason = io::foreignMarkersReason(c.slam); !reason.empty()) {
    return Error{file.string() + ": slam: " + reason};
  }
  if (Status channels = checkChannels(c, file); !channels) return channels;
  if (Status natural = checkNatural(c, file); !natural) return natural;
  if (c.record.quota_mib > 0 && c.record.quota_mib < c.record.file_mib) {
    return Error{file.string() + ": record.quota_mib: smaller than one file (record.file_mib, " +
                 std::to_string(c.record.file_mib) + ")"};
  }
  const io::MapSettings& map = c.slam.map;
  if (map.localize_only && map.in.empty()) {
    return Error{file.string() + ": slam.localize_only: needs slam.map_in"};
  }
  if (map.localize_only && !map.out.empty()) {
    return Error{file.string() + ": slam.map_out: with localize_only nothing changes"};
  }
  return success();
}

// Sources with a scheme ("sim:walls") are no paths.
void resolvePaths(const fs::path& file, Configuration& c) {
  const auto resolve = [&](fs::path& path) {
    if (!path.empty()) path = io::besideFile(file, path);
  };
  resolve(c.camera.calibration);
  resolve(c.camera.simulator.truth_dir);
  for (Configuration::NaturalMarker& marker : c.natural) resolve(marker.image);
  resolve(c.relocalizer.markers);
  resolve(c.record.directory);
  resolve(c.control.socket);
  resolve(c.slam.map.in);
  resolve(c.slam.map.out);
  const std::string_view source = c.camera.source;
  const bool has_scheme = source.substr(0, source.find('/')).find(':') != source.npos;
  if (!has_scheme) c.camera.source = io::besideFile(file, c.camera.source).string();
}

}  // namespace

Result<Configuration> parseConfiguration(const std::string& text, const fs::path& file) {
  Configuration configuration;
  configuration.text = text;
  if (const Status read = io::readSettings(text, file, configurationKeys(configuration)); !read) {
    return read.error();
  }
  if (const Status together = checkTogether(configuration, file); !together) {
    return together.error();
  }
  configuration.slam.options.mapping = !configuration.slam.map.localize_only;
  if (lensIsUnknown(configuration)) {
    configuration.slam.options.lens.takeForGuess(configuration.slam.fov_deg.has_value());
  }
  resolvePaths(file, configuration);
  return configuration;
}

Result<Configuration> readConfiguration(const fs::path& file) {
  const Result<std::string> text = io::readTextFile(file);
  if (!text) return text.error();
  return parseConfiguration(*text, file);
}

}  // namespace waymark::daemon
