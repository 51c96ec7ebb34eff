#include "io/yaml_text.h"

#include <opencv2/core.hpp>

#include "io/number_text.h"

namespace waymark::io {
namespace {

Json convert(const cv::FileNode& node) {
  if (node.isInt()) return static_cast<int>(node);
  if (node.isReal()) return static_cast<double>(node);
  if (node.isString()) {  // OpenCV leaves a comment behind unquoted text in it
    const std::string text = static_cast<std::string>(node);
    return std::string(trim(std::string_view(text).substr(0, text.find(" #"))));
  }
  if (node.isSeq()) {
    Json list = Json::array();
    for (const cv::FileNode& element : node) list.push_back(convert(element));
    return list;
  }
  if (node.isMap()) {
    Json object = Json::object();
    for (const cv::FileNode& member : node) object[member.name()] = convert(member);
    return object;
  }
  return nullptr;
}

}  // namespace

Result<Json> parseYaml(const std::string& text, const std::string& file) {
  const std::string head = text.rfind("%YAML", 0) == 0 ? "" : "%YAML:1.0\n---\n";
  try {
    const cv::FileStorage storage(head + text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    if (storage.isOpened() && !storage.root().empty()) return convert(storage.root());
  } catch (const cv::Exception&) {
  }
  return Error{file + ": is not YAML"};
}

}  // namespace waymark::io
