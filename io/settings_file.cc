#include "io/settings_file.h"

#include <algorithm>
#include <cmath>
#include <sstream>

// Header-only and without exceptions: errors come back as values.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

namespace waymark::io {

class SettingValue {
 public:
  explicit SettingValue(const toml::node& value) : node(value) {}
  const toml::node& node;
};

namespace {

namespace fs = std::filesystem;

std::string inWords(double value) {
  std::ostringstream words;
  words << value;
  return words.str();
}

Setting wholeNumber(std::string key, std::int64_t least, std::int64_t most,
                    std::function<void(std::int64_t)> take) {
  return {std::move(key), [=](const SettingValue& v) -> Objection {
            const std::optional<std::int64_t> value = v.node.value_exact<std::int64_t>();
            if (!value) return "must be a whole number";
            if (*value < least || *value > most) {
              return "must be from " + std::to_string(least) + " to " + std::to_string(most) +
                     ", not " + std::to_string(*value);
            }
            take(*value);
            return {};
          }};
}

Error at(const fs::path& file, const toml::source_position& place, const std::string& what) {
  return {file.string() + ":" + std::to_string(place.line) + ":" + std::to_string(place.column) +
          ": " + what};
}

// Walks through one file's tables.
class SettingsReader {
 public:
  SettingsReader(const fs::path& file, std::span<const Setting> settings)
      : file_(file), settings_(settings) {}

  // `prefix` is what the keys of the table begin with.
  Status readTable(const toml::table& table, const std::string& prefix,
                   std::span<const std::string_view> others) const {
    for (const auto& [key_token, node] : table) {
      if (std::ranges::find(others, key_token.str()) != others.end() && node.is_table()) continue;
      const std::string key = prefix + std::string(key_token.str());
      if (const auto setting = std::ranges::find(settings_, key, &Setting::key);
          setting != settings_.end()) {
        if (const Objection objection = setting->read(SettingValue(node))) {
          return at(file_, node.source().begin, key + ": " + *objection);
        }
      } else if (!isSection(key)) {
        return at(file_, key_token.source().begin, key + ": unknown key");
      } else if (!node.is_table()) {
        return at(file_, node.source().begin, key + ": must be a section");
      } else if (Status status = readTable(*node.as_table(), key + ".", {}); !status) {
        return status;
      }
    }
    return success();
  }

  [[nodiscard]] Status checkRequired(const toml::table& table) const {
    for (const Setting& setting : settings_) {
      if (setting.required && !table.at_path(setting.key)) {
        return Error{file_.string() + ": " + setting.key + ": missing"};
      }
    }
    return success();
  }

 private:
  [[nodiscard]] bool isSection(const std::string& key) const {
    return std::ranges::any_of(
        settings_, [&](const Setting& setting) { return setting.key.starts_with(key + "."); });
  }

  const fs::path& file_;
  std::span<const Setting> settings_;
};

}  // namespace

Setting required(Setting setting) {
  setting.required = true;
  return setting;
}

Setting textSetting(std::string key, std::string& target, TextCheck object) {
  return {std::move(key), [&target, object](const SettingValue& v) -> Objection {
            const std::optional<std::string> value = v.node.value_exact<std::string>();
            if (!value) return "must be text in quotes";
            if (value->empty()) return "must not be empty";
            if (object) {
              if (Objection objection = object(*value)) return objection;
            }
            target = *value;
            return {};
          }};
}

Setting pathSetting(std::string key, fs::path& target) {
  return {std::move(key), [&target](const SettingValue& v) -> Objection {
            const std::optional<std::string> value = v.node.value_exact<std::string>();
            if (!value) return "must be text in quotes";
            if (value->empty()) return "must not be empty";
            target = *value;
            return {};
          }};
}

Setting flagSetting(std::string key, bool& target) {
  return {std::move(key), [&target](const SettingValue& v) -> Objection {
            const std::optional<bool> value = v.node.value_exact<bool>();
            if (!value) return "must be true or false";
            target = *value;
            return {};
          }};
}

Setting integerSetting(std::string key, int& target, int least, int most) {
  return wholeNumber(std::move(key), least, most,
                     [&target](std::int64_t value) { target = static_cast<int>(value); });
}

Setting integerSetting(std::string key, std::uint64_t& target, std::int64_t least,
                       std::int64_t most) {
  return wholeNumber(std::move(key), least, most,
                     [&target](std::int64_t value) { target = static_cast<std::uint64_t>(value); });
}

Setting numberSetting(std::string key, double& target, double least, double most,
                      std::string_view unit) {
  return {std::move(key),
          [&target, least, most, unit = std::string(unit)](const SettingValue& v) -> Objection {
            if (!v.node.is_number()) return "must be a number";
            const double value = v.node.value<double>().value_or(std::nan(""));
            if (!(value >= least && value <= most)) {
              return "must be from " + inWords(least) + " to " + inWords(most) +
                     (unit.empty() ? "" : " " + unit) + ", not " + inWords(value);
            }
            target = value;
            return {};
          }};
}

Setting wordSetting(std::string key, std::vector<std::string> words,
                    std::function<void(std::size_t)> take) {
  return {std::move(key), [words, take](const SettingValue& v) -> Objection {
            const std::optional<std::string> word = v.node.value_exact<std::string>();
            const auto found = word ? std::ranges::find(words, *word) : words.end();
            if (found != words.end()) {
              take(static_cast<std::size_t>(found - words.begin()));
              return {};
            }
            std::string known;
            for (const std::string& other : words) {
              known += (known.empty() ? "\"" : ", \"") + other + "\"";
            }
            return "must be one of " + known;
          }};
}

Status readSettings(const std::string& text, const fs::path& file,
                    std::span<const Setting> settings, std::span<const std::string_view> others) {
  const toml::parse_result parsed = toml::parse(text);
  if (!parsed) {
    return at(file, parsed.error().source().begin, std::string(parsed.error().description()));
  }
  const SettingsReader reader(file, settings);
  if (Status status = reader.readTable(parsed.table(), "", others); !status) return status;
  return reader.checkRequired(parsed.table());
}

fs::path besideFile(const fs::path& file, const fs::path& path) {
  return path.is_relative() ? file.parent_path() / path : path;
}

}  // namespace waymark::io
