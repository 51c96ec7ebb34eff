#include "io/settings/settings_file.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

// Header-only and without exceptions: errors come back as values.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "io/text/closest_word.h"
#include "io/text/number_text.h"

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
  return {std::move(key),
          [least, most, take = std::move(take)](const SettingValue& v) -> ValidationError {
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

Setting number(std::string key, double least, double most, std::string_view unit,
               std::function<void(double)> take) {
  return {std::move(key),
          [take = std::move(take), least, most,
           unit = std::string(unit)](const SettingValue& v) -> ValidationError {
            if (!v.node.is_number()) return "must be a number";
            const double value = v.node.value<double>().value_or(std::nan(""));
            if (!(value >= least && value <= most)) {
              return "must be from " + inWords(least) + " to " + inWords(most) +
                     (unit.empty() ? "" : " " + unit) + ", not " + inWords(value);
            }
            take(value);
            return {};
          }};
}

std::optional<FreeValue> freeValue(const toml::node& node) {
  if (const auto whole = node.value_exact<std::int64_t>()) return *whole;
  if (const auto number = node.value_exact<double>()) return *number;
  if (const auto flag = node.value_exact<bool>()) return *flag;
  if (const auto text = node.value_exact<std::string>()) return *text;
  return {};
}

Error at(const fs::path& file, const toml::source_position& place, const std::string& what) {
  return {file.string() + ":" + std::to_string(place.line) + ":" + std::to_string(place.column) +
          ": " + oneLine(what)};
}

// Walks through one file's tables.
class SettingsReader {
 public:
  // `where` is what the keys of these settings begin with in messages.
  SettingsReader(const fs::path& file, std::span<const Setting> settings, std::string where = "")
      : file_(file), settings_(settings), where_(std::move(where)) {}

  // `prefix` is what the keys of the table begin with.
  Status readTable(const toml::table& table, const std::string& prefix,
                   std::span<const std::string_view> others) const {
    for (const auto& [key_token, node] : table) {
      if (std::ranges::find(others, key_token.str()) != others.end() &&
          (node.is_table() || node.is_array_of_tables())) {
        if (Status read = readKnown(node, std::string(key_token.str()) + "."); !read) return read;
        continue;
      }
      const std::string key = prefix + std::string(key_token.str());
      if (const auto setting = std::ranges::find(settings_, key, &Setting::key);
          setting != settings_.end()) {
        if (!setting->renamed_to.empty()) {
          return at(file_, key_token.source().begin,
                    where_ + key + " is now " + where_ + setting->renamed_to);
        }
        if (Status read = readSetting(*setting, node); !read) return read;
      } else if (!isSection(key)) {
        return at(file_, key_token.source().begin, where_ + key + ": unknown key" + meant(key));
      } else if (!node.is_table()) {
        return at(file_, node.source().begin, where_ + key + ": must be a section");
      } else if (Status status = readTable(*node.as_table(), key + ".", {}); !status) {
        return status;
      }
    }
    return success();
  }

  [[nodiscard]] Status checkRequired(const toml::table& table) const {
    for (const Setting& setting : settings_) {
      if (!setting.required || table.at_path(setting.key)) continue;
      const std::string what = where_ + setting.key + ": missing";
      if (where_.empty()) return Error{file_.string() + ": " + what};
      return at(file_, table.source().begin, what);
    }
    return success();
  }

 private:
  // Of somebody else's section what concerns us, too.
  [[nodiscard]] Status readKnown(const toml::node& section, const std::string& prefix) const {
    if (!section.is_table()) return success();
    for (const auto& [key_token, node] : *section.as_table()) {
      const std::string key = prefix + std::string(key_token.str());
      const auto setting = std::ranges::find(settings_, key, &Setting::key);
      if (setting == settings_.end()) continue;
      if (Status read = readSetting(*setting, node); !read) return read;
    }
    return success();
  }
  [[nodiscard]] Status readSetting(const Setting& setting, const toml::node& node) const {
    if (setting.element) return readElements(setting, node);
    if (const ValidationError objection = setting.read(SettingValue(node))) {
      return at(file_, node.source().begin, where_ + setting.key + ": " + *objection);
    }
    return success();
  }

  [[nodiscard]] Status readElements(const Setting& setting, const toml::node& node) const {
    if (!node.is_array_of_tables()) {
      return at(file_, node.source().begin,
                where_ + setting.key + ": must be sections [[" + setting.key + "]]");
    }
    for (const toml::node& element : *node.as_array()) {
      const std::vector<Setting> keys = setting.element();
      const SettingsReader reader(file_, keys, where_ + setting.key + ".");
      const toml::table& table = *element.as_table();
      if (Status read = reader.readTable(table, "", {}); !read) return read;
      if (Status complete = reader.checkRequired(table); !complete) return complete;
    }
    return success();
  }

  // Of a key that is none: the key or section that it may have been meant to be, for the message.
  [[nodiscard]] std::string meant(const std::string& key) const {
    std::vector<std::string> known;
    for (const Setting& setting : settings_) {
      if (!setting.renamed_to.empty()) continue;
      known.push_back(setting.key);
      for (auto dot = setting.key.find('.'); dot != setting.key.npos;
           dot = setting.key.find('.', dot + 1)) {
        known.push_back(setting.key.substr(0, dot));
      }
    }
    return didYouMean(key, known);
  }

  [[nodiscard]] bool isSection(const std::string& key) const {
    return std::ranges::any_of(
        settings_, [&](const Setting& setting) { return setting.key.starts_with(key + "."); });
  }

  const fs::path& file_;
  std::span<const Setting> settings_;
  std::string where_;
};

void addSettingTexts(const toml::table& table, const std::string& prefix, SettingTexts* texts) {
  for (const auto& [key_token, node] : table) {
    const std::string key = prefix + std::string(key_token.str());
    if (node.is_table()) {
      addSettingTexts(*node.as_table(), key + ".", texts);
      continue;
    }
    std::ostringstream value;
    node.visit([&](const auto& of_its_type) { value << of_its_type; });
    texts->emplace(key, value.str());
  }
}

// Each dot of a key is a table within a table, and taking them down again needs a stack as deep. No
// key of ours has more than four; the parser itself bounds what is nested in brackets. Empty when
// there are few in each line.
std::optional<toml::source_position> manyDotsAt(std::string_view text) {
  constexpr int kMax = 100;
  toml::source_position place{1, 0};
  int dots = 0;
  for (const char c : text) {
    ++place.column;
    if (c == '\n') {
      ++place.line;
      place.column = 0;
      dots = 0;
    } else if (c == '.' && ++dots > kMax) {
      return place;
    }
  }
  return std::nullopt;
}

}  // namespace

Setting required(Setting setting) {
  setting.required = true;
  return setting;
}

Setting renamedSetting(std::string old_key, std::string key) {
  Setting setting;
  setting.key = std::move(old_key);
  setting.renamed_to = std::move(key);
  return setting;
}

Setting checkedTextSetting(std::string key, TextCheck take) {
  return {std::move(key), [take = std::move(take)](const SettingValue& v) -> ValidationError {
            const std::optional<std::string> value = v.node.value_exact<std::string>();
            if (!value) return "must be text in quotes";
            if (value->empty()) return "must not be empty";
            // The system's names end there.
            if (value->find('\0') != value->npos) return "must not contain NUL";
            return take(*value);
          }};
}

Setting textSetting(std::string key, std::string& target, TextCheck object) {
  return checkedTextSetting(std::move(key),
                            [&target, object = std::move(object)](const std::string& text) {
                              ValidationError objection = object ? object(text) : std::nullopt;
                              if (!objection) target = text;
                              return objection;
                            });
}

Setting pathSetting(std::string key, fs::path& target) {
  return checkedTextSetting(std::move(key), [&target](const std::string& text) -> ValidationError {
    target = text;
    return {};
  });
}

Setting flagSetting(std::string key, bool& target) {
  return {std::move(key), [&target](const SettingValue& v) -> ValidationError {
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

Setting integerSetting(std::string key, std::optional<int>& target, int least, int most) {
  return wholeNumber(std::move(key), least, most,
                     [&target](std::int64_t value) { target = static_cast<int>(value); });
}

Setting numbersSetting(std::string key, std::size_t count, NumbersTaker take) {
  return {std::move(key),
          [count, take = std::move(take)](const SettingValue& v) -> ValidationError {
            const toml::array* list = v.node.as_array();
            std::vector<double> numbers;
            for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
              const toml::node& element = *list->get(i);
              const double number = element.value<double>().value_or(std::nan(""));
              if (element.is_number() && std::isfinite(number)) numbers.push_back(number);
            }
            if (list == nullptr || list->size() != count || numbers.size() != count) {
              return "must be a list of " + std::to_string(count) + " numbers";
            }
            return take(numbers);
          }};
}

Setting numberSetting(std::string key, double& target, double least, double most,
                      std::string_view unit) {
  return number(std::move(key), least, most, unit, [&target](double value) { target = value; });
}

Setting numberSetting(std::string key, std::optional<double>& target, double least, double most,
                      std::string_view unit) {
  return number(std::move(key), least, most, unit, [&target](double value) { target = value; });
}

Setting freeSection(std::string key, std::map<std::string, FreeValue>& target) {
  return {std::move(key), [&target](const SettingValue& v) -> ValidationError {
            const toml::table* section = v.node.as_table();
            if (section == nullptr) return "must be a section";
            for (const auto& [name, node] : *section) {
              const std::optional<FreeValue> value = freeValue(node);
              if (!value) {
                return std::string(name.str()) + " must be a number, true or false, or text";
              }
              target.emplace(name.str(), *value);
            }
            return {};
          }};
}

Setting wordSetting(std::string key, std::vector<std::string> words,
                    std::function<void(std::size_t)> take) {
  return {
      std::move(key),
      [words = std::move(words), take = std::move(take)](const SettingValue& v) -> ValidationError {
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
  if (const auto place = manyDotsAt(text)) return at(file, *place, "has too many dots");
  const toml::parse_result parsed = toml::parse(text);
  if (!parsed) {
    return at(file, parsed.error().source().begin, std::string(parsed.error().description()));
  }
  const SettingsReader reader(file, settings);
  if (Status status = reader.readTable(parsed.table(), "", others); !status) return status;
  return reader.checkRequired(parsed.table());
}

SettingTexts settingTexts(const std::string& text) {
  SettingTexts texts;
  if (manyDotsAt(text)) return texts;
  const toml::parse_result parsed = toml::parse(text);
  if (parsed) addSettingTexts(parsed.table(), "", &texts);
  return texts;
}

std::vector<std::string> changedSettings(const SettingTexts& a, const SettingTexts& b) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : a) {
    const auto found = b.find(key);
    if (found == b.end() || found->second != value) keys.push_back(key);
  }
  for (const auto& [key, value] : b) {
    if (!a.contains(key)) keys.push_back(key);
  }
  std::ranges::sort(keys);
  return keys;
}

fs::path besideFile(const fs::path& file, const fs::path& path) {
  return path.is_relative() ? file.parent_path() / path : path;
}

}  // namespace waymark::io
