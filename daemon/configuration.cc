#include "daemon/configuration.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

// Header-only and without exceptions: errors come back as values.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "daemon/lcm_link.h"
#include "slam/detection/dictionary.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

// Puts one value where it belongs. Returns why it cannot, or nothing.
using Reason = std::optional<std::string>;
using Reader = std::function<Reason(const toml::node&, Configuration&)>;

// --- Readers: what a value may be. `field` leads from the configuration to the member. ----------

template <typename Field>
Reader text(Field field, std::function<Reason(const std::string&)> check = nullptr) {
  return [=](const toml::node& node, Configuration& c) -> Reason {
    const std::optional<std::string> value = node.value_exact<std::string>();
    if (!value) return "must be text in quotes";
    if (value->empty()) return "must not be empty";
    if (check) {
      if (Reason reason = check(*value)) return reason;
    }
    field(c) = *value;
    return {};
  };
}

template <typename Field>
Reader flag(Field field) {
  return [=](const toml::node& node, Configuration& c) -> Reason {
    const std::optional<bool> value = node.value_exact<bool>();
    if (!value) return "must be true or false";
    field(c) = *value;
    return {};
  };
}

template <typename Field>
Reader integer(Field field, std::int64_t least, std::int64_t most) {
  return [=](const toml::node& node, Configuration& c) -> Reason {
    const std::optional<std::int64_t> value = node.value_exact<std::int64_t>();
    if (!value) return "must be a whole number";
    if (*value < least || *value > most) {
      return "must be from " + std::to_string(least) + " to " + std::to_string(most) + ", not " +
             std::to_string(*value);
    }
    field(c) = static_cast<std::remove_reference_t<decltype(field(c))>>(*value);
    return {};
  };
}

std::string inWords(double value) {
  std::ostringstream words;
  words << value;
  return words.str();
}

template <typename Field>
Reader number(Field field, double least, double most, std::string_view unit) {
  return [=](const toml::node& node, Configuration& c) -> Reason {
    if (!node.is_number()) return "must be a number";
    const double value = node.value<double>().value_or(std::nan(""));
    if (!(value >= least && value <= most)) {
      return "must be from " + inWords(least) + " to " + inWords(most) +
             (unit.empty() ? "" : " " + std::string(unit)) + ", not " + inWords(value);
    }
    field(c) = value;
    return {};
  };
}

template <typename Field, typename Value>
Reader choice(Field field, std::vector<std::pair<std::string, Value>> choices) {
  return [=](const toml::node& node, Configuration& c) -> Reason {
    const std::optional<std::string> name = node.value_exact<std::string>();
    std::string known;
    for (const auto& [choice_name, value] : choices) {
      if (name == choice_name) {
        field(c) = value;
        return {};
      }
      known += (known.empty() ? "\"" : ", \"") + choice_name + "\"";
    }
    return "must be one of " + known;
  };
}

// --- Checks of texts ----------------------------------------------------------------------------

Reason checkDictionary(const std::string& name) {
  if (slam::Dictionary::byName(name)) return {};
  std::string known;
  for (const std::string& other : slam::Dictionary::names()) known += " " + other;
  return "\"" + name + "\" is not a known dictionary; known are" + known;
}

Reason checkUrl(const std::string& url) {
  if (multicastAddress(url)) return {};
  return "must be like \"udpm://239.255.76.67:7667?ttl=0\" with a multicast address, not \"" + url +
         "\"";
}

// LCM allows 63 characters for a channel; the longest name after the prefix is "DETECTIONS".
Reason checkChannel(const std::string& name) {
  constexpr std::size_t kMost = 50;
  const auto plain = [](unsigned char c) { return c > ' ' && c < 127; };
  if (name.size() <= kMost && std::ranges::all_of(name, plain)) return {};
  return "must be at most 50 characters without spaces";
}

// --- The rules: one row for each key ------------------------------------------------------------

struct Rule {
  std::string_view key;
  bool required;
  Reader read;
};

#define FIELD(path) \
  [](Configuration & c) -> auto& { return c.path; }

const std::vector<Rule>& rules() {
  constexpr bool kRequired = true;
  constexpr bool kOptional = false;
  constexpr std::int64_t kMaxSeed = std::numeric_limits<std::int64_t>::max();
  static const std::vector<Rule> table = {
      {"camera.source", kRequired, text(FIELD(camera.source))},
      {"camera.calibration", kOptional, text(FIELD(camera.calibration))},
      {"camera.rate_hz", kOptional, number(FIELD(camera.rate_hz), 0.1, 1000.0, "Hz")},
      {"camera.simulator.seed", kOptional, integer(FIELD(camera.simulator.seed), 0, kMaxSeed)},
      {"camera.simulator.width", kOptional, integer(FIELD(camera.simulator.width), 64, 4096)},
      {"camera.simulator.height", kOptional, integer(FIELD(camera.simulator.height), 64, 4096)},
      {"camera.simulator.loop_s", kOptional,
       number(FIELD(camera.simulator.loop_s), 0.1, 120.0, "s")},
      {"camera.simulator.truth_dir", kOptional, text(FIELD(camera.simulator.truth_dir))},
      {"slam.dictionary", kRequired, text(FIELD(slam.dictionary), checkDictionary)},
      {"slam.marker_size_m", kRequired,
       number(FIELD(slam.options.marker_size_m), 1e-3, 100.0, "m")},
      {"slam.detector.scanner.threshold_window_px", kOptional,
       integer(FIELD(slam.options.detector.scanner.threshold_window_px), 3, 255)},
      {"slam.detector.scanner.min_side_px", kOptional,
       number(FIELD(slam.options.detector.scanner.min_side_px), 4.0, 1000.0, "px")},
      {"slam.detector.edges.fit.min_contrast", kOptional,
       number(FIELD(slam.options.detector.edges.fit.min_contrast), 1.0, 255.0, "grey levels")},
      {"slam.detector.decoder.max_wrong_bits", kOptional,
       integer(FIELD(slam.options.detector.decoder.max_wrong_bits), 0, 8)},
      {"slam.initialisation.ambiguity_ratio", kOptional,
       number(FIELD(slam.options.initialisation.ambiguity_ratio), 1.0, 1000.0, "")},
      {"slam.tracking.marker_chi2", kOptional,
       number(FIELD(slam.options.tracking.marker_chi2), 1.0, 1e6, "")},
      {"slam.tracking.worst_rms_px", kOptional,
       number(FIELD(slam.options.tracking.worst_rms_px), 0.1, 100.0, "px")},
      {"slam.motion.max_extrapolation_s", kOptional,
       number(FIELD(slam.options.motion.max_extrapolation_s), 0.0, 10.0, "s")},
      {"slam.keyframes.min_baseline_m", kOptional,
       number(FIELD(slam.options.keyframes.min_baseline_m), 1e-4, 100.0, "m")},
      {"slam.keyframes.min_baseline_per_depth", kOptional,
       number(FIELD(slam.options.keyframes.min_baseline_per_depth), 0.0, 10.0, "")},
      {"slam.keyframes.min_rotation_rad", kOptional,
       number(FIELD(slam.options.keyframes.min_rotation_rad), 1e-3, 3.0, "rad")},
      {"slam.keyframes.views_per_marker", kOptional,
       integer(FIELD(slam.options.keyframes.views_per_marker), 2, 1000)},
      {"slam.marker_pose.min_views", kOptional,
       integer(FIELD(slam.options.marker_pose.min_views), 2, 100)},
      {"slam.marker_pose.ambiguity_ratio", kOptional,
       number(FIELD(slam.options.marker_pose.ambiguity_ratio), 1.0, 1000.0, "")},
      {"slam.relocalisation.ambiguity_ratio", kOptional,
       number(FIELD(slam.options.relocalisation.ambiguity_ratio), 1.0, 1000.0, "")},
      {"slam.local_optimisation.max_iterations", kOptional,
       integer(FIELD(slam.options.local_optimisation.max_iterations), 1, 100)},
      {"queue.depth", kOptional, integer(FIELD(queue.depth), 1, 64)},
      {"publish.url", kOptional, text(FIELD(publish.url), checkUrl)},
      {"publish.channel_prefix", kOptional, text(FIELD(publish.channel_prefix), checkChannel)},
      {"publish.pose_channel", kOptional, text(FIELD(publish.pose_channel), checkChannel)},
      {"publish.detections", kOptional, flag(FIELD(publish.detections))},
      {"log.level", kOptional,
       choice<>(FIELD(log.level),
                std::vector<std::pair<std::string, LogLevel>>{{"error", LogLevel::kError},
                                                              {"warning", LogLevel::kWarning},
                                                              {"info", LogLevel::kInfo},
                                                              {"debug", LogLevel::kDebug}})},
  };
  return table;
}

#undef FIELD

// --- Walking the file ---------------------------------------------------------------------------

Error at(const fs::path& file, const toml::source_position& place, const std::string& what) {
  return {file.string() + ":" + std::to_string(place.line) + ":" + std::to_string(place.column) +
          ": " + what};
}

const Rule* findRule(const std::string& key) {
  const auto rule = std::ranges::find(rules(), key, &Rule::key);
  return rule == rules().end() ? nullptr : &*rule;
}

bool isSection(const std::string& key) {
  return std::ranges::any_of(rules(),
                             [&](const Rule& rule) { return rule.key.starts_with(key + "."); });
}

// Reads `table`, whose keys begin with `prefix`, into `configuration`.
Status readTable(const toml::table& table, const std::string& prefix, const fs::path& file,
                 Configuration& configuration) {
  for (const auto& [key_token, node] : table) {
    const std::string key = prefix + std::string(key_token.str());
    if (const Rule* rule = findRule(key)) {
      if (const Reason reason = rule->read(node, configuration)) {
        return at(file, node.source().begin, key + ": " + *reason);
      }
    } else if (!isSection(key)) {
      return at(file, key_token.source().begin, key + ": unknown key");
    } else if (!node.is_table()) {
      return at(file, node.source().begin, key + ": must be a section");
    } else if (Status status = readTable(*node.as_table(), key + ".", file, configuration);
               !status) {
      return status;
    }
  }
  return success();
}

Status checkRequired(const toml::table& table, const fs::path& file) {
  for (const Rule& rule : rules()) {
    if (rule.required && !table.at_path(rule.key)) {
      return Error{file.string() + ": " + std::string(rule.key) + ": missing"};
    }
  }
  return success();
}

bool simulated(const Configuration& c) { return c.camera.source.starts_with("sim:"); }

// What no single key can say.
Status checkTogether(const Configuration& c, const fs::path& file) {
  if (!simulated(c) && c.camera.calibration.empty()) {
    return Error{file.string() + ": camera.calibration: missing; only simulated cameras bring one"};
  }
  if (const std::string reason = c.slam.options.invalidReason(); !reason.empty()) {
    return Error{file.string() + ": slam: " + reason};
  }
  return success();
}

// Paths count from the file's directory; sources with a scheme ("v4l2:...") are no paths.
void resolvePaths(const fs::path& file, Configuration& c) {
  const fs::path base = file.parent_path();
  const auto resolve = [&](fs::path& path) {
    if (!path.empty() && path.is_relative()) path = base / path;
  };
  resolve(c.camera.calibration);
  resolve(c.camera.simulator.truth_dir);
  const std::string_view source = c.camera.source;
  const bool has_scheme = source.substr(0, source.find('/')).find(':') != source.npos;
  if (!has_scheme) c.camera.source = (base / c.camera.source).string();
}

}  // namespace

Result<Configuration> parseConfiguration(const std::string& text, const fs::path& file) {
  const toml::parse_result parsed = toml::parse(text);
  if (!parsed) {
    return at(file, parsed.error().source().begin, std::string(parsed.error().description()));
  }
  const toml::table& table = parsed.table();
  Configuration configuration;
  if (Status status = readTable(table, "", file, configuration); !status) return status.error();
  if (Status status = checkRequired(table, file); !status) return status.error();
  if (Status status = checkTogether(configuration, file); !status) return status.error();
  resolvePaths(file, configuration);
  return configuration;
}

Result<Configuration> readConfiguration(const fs::path& file) {
  std::error_code ignored;
  if (fs::is_directory(file, ignored)) return Error{file.string() + ": is a directory"};
  errno = 0;
  std::ifstream stream(file, std::ios::binary);
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  if (!stream.is_open() || stream.bad()) {
    return Error{file.string() + ": cannot be read: " + std::strerror(errno)};  // NOLINT: at start
  }
  return parseConfiguration(text, file);
}

}  // namespace waymark::daemon
