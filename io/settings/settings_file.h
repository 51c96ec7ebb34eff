// Settings from TOML files, checked key by key before anything starts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/result.h"

namespace waymark::io {

// A value as it stands in the file; only settings_file.cc looks inside.
class SettingValue;

// Why a value cannot be; empty when it can.
using ValidationError = std::optional<std::string>;

// One key: what its value may be, and where it goes. The target must outlive the setting.
struct Setting {
  std::string key;  // with its sections: "camera.simulator.seed"
  std::function<ValidationError(const SettingValue&)> read;
  bool required = false;
  // A list of sections ([[key]]): begins the next element and says which keys it has. Where this is
  // set, `read` is not.
  std::function<std::vector<Setting>()> element = nullptr;
  // A key of old files that has this name by now: an error that says so. `read` is not set.
  std::string renamed_to{};
};

[[nodiscard]] Setting required(Setting setting);
[[nodiscard]] Setting renamedSetting(std::string old_key, std::string key);

// Text in quotes, not empty; `object` may have more to say about it.
using TextCheck = std::function<ValidationError(const std::string&)>;
[[nodiscard]] Setting textSetting(std::string key, std::string& target, TextCheck object = nullptr);
// The same where the check itself knows what to do with the text.
[[nodiscard]] Setting checkedTextSetting(std::string key, TextCheck take);
[[nodiscard]] Setting pathSetting(std::string key, std::filesystem::path& target);

[[nodiscard]] Setting flagSetting(std::string key, bool& target);

// A whole number from `least` to `most`.
[[nodiscard]] Setting integerSetting(std::string key, int& target, int least, int most);
[[nodiscard]] Setting integerSetting(std::string key, std::optional<int>& target, int least,
                                     int most);
[[nodiscard]] Setting integerSetting(std::string key, std::uint64_t& target, std::int64_t least,
                                     std::int64_t most);

// Any number from `least` to `most`; `unit` is for the message.
[[nodiscard]] Setting numberSetting(std::string key, double& target, double least, double most,
                                    std::string_view unit);
[[nodiscard]] Setting numberSetting(std::string key, std::optional<double>& target, double least,
                                    double most, std::string_view unit);

// As many finite numbers as `count`, [1.0, 2.0]; `take` may object to them.
using NumbersTaker = std::function<ValidationError(std::span<const double>)>;
[[nodiscard]] Setting numbersSetting(std::string key, std::size_t count, NumbersTaker take);

// A list of sections, [[key]]: `target` gets an element for each, and `keys` says what its keys,
// without `key`, are for.
template <typename Element>
[[nodiscard]] Setting sectionsSetting(std::string key, std::vector<Element>& target,
                                      std::function<std::vector<Setting>(Element&)> keys) {
  return {std::move(key), nullptr, false,
          [&target, keys = std::move(keys)] { return keys(target.emplace_back()); }};
}

// A section whose keys somebody else knows: each a whole number, a number, true or false, or text.
using FreeValue = std::variant<std::int64_t, double, bool, std::string>;
[[nodiscard]] Setting freeSection(std::string key, std::map<std::string, FreeValue>& target);

// One of some words in quotes; `take` gets the index of the word.
[[nodiscard]] Setting wordSetting(std::string key, std::vector<std::string> words,
                                  std::function<void(std::size_t)> take);
// The same where each word stands for a value.
template <typename Value>
[[nodiscard]] Setting choiceSetting(std::string key, Value& target,
                                    const std::vector<std::pair<std::string, Value>>& choices) {
  std::vector<std::string> words;
  words.reserve(choices.size());
  for (const auto& choice : choices) words.push_back(choice.first);
  return wordSetting(std::move(key), std::move(words),
                     [&target, choices](std::size_t i) { target = choices[i].second; });
}

// Gives every key of the text to its setting. Syntax errors, unknown keys, wrong types, impossible
// values, missing and renamed keys are errors: "FILE:LINE:COLUMN: KEY: reason". What is in one of
// the top-level sections `others` is somebody else's and passed over, but for keys among
// `settings`.
[[nodiscard]] Status readSettings(const std::string& text, const std::filesystem::path& file,
                                  std::span<const Setting> settings,
                                  std::span<const std::string_view> others = {});

// Every key of a text with its value as text, however it is written: comments, order and spaces do
// not show. Lists of sections count as one value. Nothing of a text that is no TOML.
using SettingTexts = std::map<std::string, std::string>;
[[nodiscard]] SettingTexts settingTexts(const std::string& text);

// The keys that are in one only, or have another value there.
[[nodiscard]] std::vector<std::string> changedSettings(const SettingTexts& a,
                                                       const SettingTexts& b);

// A path in the file counts from the file's own directory.
[[nodiscard]] std::filesystem::path besideFile(const std::filesystem::path& file,
                                               const std::filesystem::path& path);

}  // namespace waymark::io
