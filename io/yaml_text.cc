#include "io/yaml_text.h"

#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>

#include <opencv2/core.hpp>
#include <yaml-cpp/yaml.h>

#include "io/number_text.h"

namespace waymark::io {
namespace {

// Aliases make a small file a huge one, or one without end: more than this is no file of ours.
constexpr int kMostNodes = 2'000'000;
constexpr int kDeepest = 100;

class Converter {
 public:
  // Empty when there is too much of it.
  std::optional<Json> convert(const YAML::Node& node, int depth = 0) {
    if (++nodes_ > kMostNodes || depth > kDeepest) return std::nullopt;
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
    for (const auto& member : node) {
      std::optional<Json> converted = convert(member.second, depth + 1);
      if (!converted) return std::nullopt;
      result[member.first.IsScalar() ? member.first.Scalar() : ""] = std::move(*converted);
    }
    return result;
  }

  int nodes_ = 0;
};

Json fromOpenCv(const cv::FileNode& node) {
  if (node.isInt()) return static_cast<int>(node);
  if (node.isReal()) return static_cast<double>(node);
  if (node.isString()) {  // OpenCV leaves a comment behind unquoted text in it
    const std::string text = static_cast<std::string>(node);
    return std::string(trim(std::string_view(text).substr(0, text.find(" #"))));
  }
  if (node.isSeq()) {
    Json list = Json::array();
    for (const cv::FileNode& element : node) list.push_back(fromOpenCv(element));
    return list;
  }
  if (node.isMap()) {
    Json object = Json::object();
    for (const cv::FileNode& member : node) object[member.name()] = fromOpenCv(member);
    return object;
  }
  return nullptr;
}

// A flow map like {id:0} is none to other parsers.
Result<Json> parseOpenCvYaml(const std::string& text, const std::string& file) {
  try {
    const cv::FileStorage storage(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    if (storage.isOpened() && !storage.root().empty()) return fromOpenCv(storage.root());
  } catch (const cv::Exception&) {
  }
  return Error{file + ": is not YAML"};
}

}  // namespace

Result<Json> parseYaml(const std::string& text, const std::string& file) {
  if (text.starts_with("%YAML:")) return parseOpenCvYaml(text, file);
  try {
    const YAML::Node root = YAML::Load(text);
    if (!root.IsMap() && !root.IsSequence()) return Error{file + ": is not YAML"};
    std::optional<Json> converted = Converter().convert(root);
    if (!converted) return Error{file + ": is nested too deeply"};
    return std::move(*converted);
  } catch (const YAML::Exception& error) {
    return Error{file + ":" + std::to_string(error.mark.line + 1) + ":" +
                 std::to_string(error.mark.column + 1) + ": is not YAML: " + oneLine(error.msg)};
  }
}

}  // namespace waymark::io
