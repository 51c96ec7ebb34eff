#include "io/pictures/print_file.h"

#include <utility>

#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "io/text/plausible.h"

namespace waymark::io {
namespace {

constexpr const char* kFormat = "waymark-prints";
constexpr int kVersion = 1;

double readSize(const JsonNode& node) {
  const double size_m = node.positive();
  if (node.good() && !isSize(size_m)) node.fail(kSizes);
  return size_m;
}

slam::PicturePrint readPrint(const JsonNode& node) {
  slam::PicturePrint print;
  print.name = node.at("name").text();
  print.width_m = readSize(node.at("width"));
  print.height_m = readSize(node.at("height"));
  if (node.has("T_w_m")) print.T_w_m = node.at("T_w_m").transform();
  print.sigma_m = node.at("sigma_m").positive();
  print.sigma_rad = node.at("sigma_rad").positive();
  for (const JsonNode& point : node.at("points").elements()) {
    print.points_m.push_back(point.point2());
  }
  return print;
}

Json printJson(const slam::PicturePrint& print) {
  Json json = {{"name", print.name}, {"width", print.width_m}, {"height", print.height_m}};
  if (print.T_w_m) json["T_w_m"] = toJson(*print.T_w_m);
  json["sigma_m"] = print.sigma_m;
  json["sigma_rad"] = print.sigma_rad;
  json["points"] = Json::array();
  for (const Eigen::Vector2d& point : print.points_m) json["points"].push_back(toJson(point));
  return json;
}

}  // namespace

std::string formatPrints(const std::vector<slam::PicturePrint>& prints) {
  std::vector<Json> markers;
  markers.reserve(prints.size());
  for (const slam::PicturePrint& print : prints) markers.push_back(printJson(print));
  return "{" + jsonField("format", kFormat) + jsonField("version", kVersion) +
         jsonList("markers", markers) + "}\n";
}

Result<std::vector<slam::PicturePrint>> parsePrints(const std::string& text,
                                                    const std::filesystem::path& file) {
  const Result<Json> json = parseJson(text, file.string());
  if (!json) return json.error();
  std::string fault;
  const JsonNode root(*json, &fault);
  const std::string format = root.at("format").text();
  if (root.good() && format != kFormat) {
    root.at("format").fail("is '" + oneLine(format) + "', not '" + kFormat + "'");
  }
  (void)root.at("version").integer(kVersion, kVersion);
  std::vector<slam::PicturePrint> prints;
  if (fault.empty()) {
    for (const JsonNode& node : root.at("markers").elements()) {
      prints.push_back(readPrint(node));
      if (!fault.empty()) break;
    }
  }
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return prints;
}

}  // namespace waymark::io
