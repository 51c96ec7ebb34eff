#include "io/text/yaml_text.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>

#include <yaml-cpp/yaml.h>

#include "io/text/number_text.h"

namespace waymark::io {
namespace {

// Aliases make a small file a huge one, or one without end: more than this is no file of ours.
constexpr std::size_t kMaxNodes = 500'000;
constexpr std::size_t kMaxTextBytes = std::size_t{16} << 20U;
constexpr int kDeepest = 100;
// Members are found one by one.
constexpr std::size_t kMaxMembers = 1000;

class Converter {
 public:
  // Empty when there is too much of it.
  std::optional<Json> convert(const YAML::Node& node, int depth = 0) {
    if (++nodes_ > kMaxNodes || depth > kDeepest) return std::nullopt;
    if (node.IsScalar()) text_bytes_ += node.Scalar().size();
    if (text_bytes_ > kMaxTextBytes) return std::nullopt;
    if (node.IsScalar()) return scalar(node);
    if (node.IsSequence()) return list(node, depth);
    if (node.IsMap()) return object(node, depth);
    return Json(nullptr);
  }

 private:
  static Json scalar(const YAML::Node& node) {
    const std::string& text = node.Scalar();
    const bool plain = node.Tag() == "?";
    if (!plain) return text;
    std::int64_t whole = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, whole);
    if (error == std::errc() && stop == end) return whole;
    if (const std::optional<double> number = parseDouble(text)) return *number;
    return text;
  }

  std::optional<Json> list(const YAML::Node& node, int depth) {
    Json result = Json::array();
    for (const YAML::Node& element : node) {
      std::optional<Json> converted = convert(element, depth + 1);
      if (!converted) return std::nullopt;
      result.push_back(std::move(*converted));
    }
    return result;
  }

  std::optional<Json> object(const YAML::Node& node, int depth) {
    Json result = Json::object();
    if (node.size() > kMaxMembers) return std::nullopt;
    for (const auto& member : node) {
      std::optional<Json> converted = convert(member.second, depth + 1);
      if (!converted) return std::nullopt;
      result[member.first.IsScalar() ? member.first.Scalar() : ""] = std::move(*converted);
    }
    return result;
  }

  std::size_t nodes_ = 0;
  std::size_t text_bytes_ = 0;
};

bool isName(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

// OpenCV's own parser trusts its files: it goes as deep as they do, until the stack ends. Its
// dialect differs in the directive of the first line, and in maps like {id:0,size:1}, where YAML
// wants a blank behind the colon; lines and their numbers stay as they are.
std::string withoutOpenCvDialect(const std::string& text) {
  std::string yaml;
  int braces = 0;
  char before_name = '\n';  // the last character that was neither blank nor of a name
  for (std::size_t i = std::min(text.find('\n'), text.size()); i < text.size(); ++i) {
    const char c = text[i];
    yaml += c;
    if (c == ' ' || c == '\n' || c == '\r' || isName(c)) continue;
    const bool key = c == ':' && braces > 0 && (before_name == '{' || before_name == ',');
    if (key && isName(text[i - 1])) yaml += ' ';
    braces += c == '{' ? 1 : (c == '}' ? -1 : 0);
    before_name = c;
  }
  return yaml;
}

}  // namespace

Result<Json> parseYaml(const std::string& text, const std::string& file) {
  try {
    const YAML::Node root =
        YAML::Load(text.starts_with("%YAML:") ? withoutOpenCvDialect(text) : text);
    if (!root.IsMap() && !root.IsSequence()) return Error{file + ": is not YAML"};
    std::optional<Json> converted = Converter().convert(root);
    if (!converted) return Error{file + ": is nested too deeply or too large"};
    return std::move(*converted);
  } catch (const YAML::Exception& error) {
    return Error{file + ":" + std::to_string(error.mark.line + 1) + ":" +
                 std::to_string(error.mark.column + 1) + ": is not YAML: " + oneLine(error.msg)};
  }
}

}  // namespace waymark::io
