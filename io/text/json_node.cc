#include "io/text/json_node.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "io/text/number_text.h"
#include "io/text/plausible.h"

namespace waymark::io {
namespace {

using Coefficients = std::array<double, 4>;  // w, x, y, z

// Rounded to 2^-46: a thousandth of a nanometre at a hundred metres, and far above what arithmetic
// adds. Without negative zeros, which compare equal but are written differently.
Coefficients rounded(const Eigen::Quaterniond& q) {
  constexpr double kStep = 0x1p-46;
  Coefficients c = {q.w(), q.x(), q.y(), q.z()};
  for (double& value : c) value = std::round(value / kStep) * kStep + 0.0;
  return c;
}

Coefficients readAndWritten(const Coefficients& q) {
  const Eigen::Quaterniond stored(q[0], q[1], q[2], q[3]);
  return rounded(slam::Transform::fromQuaternion(stored, Eigen::Vector3d::Zero()).quaternion());
}

// Line and column of a byte, both from 1.
std::string placeOf(const std::string& text, std::size_t byte) {
  const auto end = text.begin() + static_cast<std::ptrdiff_t>(std::min(byte, text.size()));
  const auto line = 1 + std::count(text.begin(), end, '\n');
  const auto line_begin = std::find(std::make_reverse_iterator(end), text.rend(), '\n').base();
  return std::to_string(line) + ":" + std::to_string(1 + (end - line_begin));
}

// The byte at which the text has more levels or more members of one object than any file of ours;
// empty when there is no such place. The parser itself takes any depth, but what walks through the
// values afterwards has a stack with an end; and members are found one by one.
std::optional<std::size_t> tooMuchAt(std::string_view text) {
  constexpr std::size_t kDeepest = 100;
  constexpr int kMaxMembers = 1000;
  struct Level {
    bool object = false;
    int commas = 0;
  };
  std::vector<Level> levels;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c == '\\') ++i;
      quoted = c != '"';
    } else if (c == '"') {
      quoted = true;
    } else if (c == '[' || c == '{') {
      levels.push_back({.object = c == '{'});
      if (levels.size() > kDeepest) return i;
    } else if ((c == ']' || c == '}') && !levels.empty()) {
      levels.pop_back();
    } else if (c == ',' && !levels.empty() && levels.back().object &&
               ++levels.back().commas >= kMaxMembers) {
      return i;
    }
  }
  return std::nullopt;
}

}  // namespace

Result<Json> parseJson(const std::string& text, const std::string& file) {
  if (const auto byte = tooMuchAt(text)) {
    return Error{file + ":" + placeOf(text, *byte) + ": is nested too deeply or has too many keys"};
  }
  try {
    return Json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    const std::size_t byte = error.byte > 0 ? error.byte - 1 : 0;
    const bool cut_off = byte >= text.size();
    return Error{file + ":" + placeOf(text, byte) + ": " +
                 (cut_off ? "is not JSON: it is cut off here" : "is not JSON")};
  } catch (const nlohmann::json::exception&) {  // a number too large for a double
    return Error{file + ": has a number that is too large"};
  }
}

bool JsonNode::has(const char* key) const { return json_->is_object() && json_->contains(key); }

JsonNode JsonNode::at(const char* key) const {
  static const Json kNothing;
  const std::string place = place_.empty() ? key : place_ + "." + key;
  if (!json_->is_object()) {
    fail("must be an object {...}");
    return {kNothing, place, fault_};
  }
  const auto found = json_->find(key);
  JsonNode member(found == json_->end() ? kNothing : *found, place, fault_);
  if (found == json_->end()) member.fail("is missing");
  return member;
}

std::vector<JsonNode> JsonNode::elements() const {
  if (!json_->is_array()) return fail("must be a list"), std::vector<JsonNode>{};
  std::vector<JsonNode> nodes;
  for (std::size_t i = 0; i < json_->size(); ++i) {
    nodes.push_back({(*json_)[i], place_ + "[" + std::to_string(i) + "]", fault_});
  }
  return nodes;
}

std::vector<JsonNode> JsonNode::elements(std::size_t count) const {
  if (json_->is_array() && json_->size() == count) return elements();
  fail("must be a list of " + std::to_string(count));
  return {};
}

double JsonNode::number() const {
  if (!json_->is_number() || !std::isfinite(json_->get<double>())) {
    return fail("must be a number"), 0.0;
  }
  return json_->get<double>();
}

double JsonNode::positive() const {
  const double value = number();
  if (good() && value <= 0.0) fail("must be positive");
  return value;
}

std::int64_t JsonNode::integer(std::int64_t least, std::int64_t most) const {
  const bool fits = json_->is_number_integer() &&
                    (!json_->is_number_unsigned() ||
                     json_->get<std::uint64_t>() <=
                         static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) &&
                    json_->get<std::int64_t>() >= least && json_->get<std::int64_t>() <= most;
  if (fits) return json_->get<std::int64_t>();
  if (most == std::numeric_limits<std::int64_t>::max()) {
    fail(least == 0 ? "must be a whole number from 0 on" : "must be a whole number");
  } else {
    fail("must be a whole number from " + std::to_string(least) + " to " + std::to_string(most));
  }
  return least;
}

std::uint64_t JsonNode::natural() const {
  if (json_->is_number_unsigned() ||
      (json_->is_number_integer() && json_->get<std::int64_t>() >= 0)) {
    return json_->get<std::uint64_t>();
  }
  fail("must be a whole number from 0 on");
  return 0;
}

std::string JsonNode::text() const {
  if (!json_->is_string() || json_->get_ref<const std::string&>().empty()) {
    return fail("must be text"), std::string();
  }
  return json_->get<std::string>();
}

std::vector<double> JsonNode::numbers(std::size_t count) const {
  std::vector<double> values;
  for (const JsonNode& element : elements(count)) values.push_back(element.number());
  values.resize(count);
  return values;
}

Eigen::Vector2d JsonNode::point2() const {
  const std::vector<double> v = numbers(2);
  return {v[0], v[1]};
}

Eigen::Vector3d JsonNode::point3() const {
  const std::vector<double> v = numbers(3);
  return {v[0], v[1], v[2]};
}

Eigen::Quaterniond JsonNode::unitQuaternion() const {
  const std::vector<double> v = numbers(4);
  const Eigen::Quaterniond q(v[0], v[1], v[2], v[3]);
  if (good() && !(std::abs(q.norm() - 1.0) < 1e-6)) fail("must have length 1");
  return good() ? q : Eigen::Quaterniond::Identity();
}

slam::Transform JsonNode::transform() const {
  const Eigen::Vector3d p = at("p").point3();
  if (good() && !isPosition(p)) at("p").fail(kPositions);
  return slam::Transform::fromQuaternion(at("q").unitQuaternion(), p);
}

void JsonNode::fail(const std::string& reason) const {
  if (good()) *fault_ = oneLine((place_.empty() ? "" : place_ + ": ") + reason);
}

// Normalizing a rounded quaternion and rounding it again nearly always gives the same; else the
// next one stays, or a few take turns. The smallest of those is the one whichever of them it starts
// from.
Eigen::Quaterniond stableQuaternion(const Eigen::Matrix3d& R) {
  std::vector<Coefficients> seen = {
      rounded(slam::Transform{R, Eigen::Vector3d::Zero()}.quaternion())};
  for (;;) {
    const Coefficients next = readAndWritten(seen.back());
    const auto before = std::find(seen.begin(), seen.end(), next);
    if (before != seen.end()) {
      const Coefficients q = *std::min_element(before, seen.end());
      return {q[0], q[1], q[2], q[3]};
    }
    seen.push_back(next);
  }
}

slam::Transform asRead(const slam::Transform& T) {
  return slam::Transform::fromQuaternion(stableQuaternion(T.R), T.p);
}

Json toJson(const Eigen::Vector2d& v) { return Json::array({v.x(), v.y()}); }
Json toJson(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }
Json toJson(const slam::Transform& T) {
  const Eigen::Quaterniond q = stableQuaternion(T.R);
  return {{"p", toJson(T.p)}, {"q", Json::array({q.w(), q.x(), q.y(), q.z()})}};
}

std::string jsonField(std::string_view key, const Json& value) {
  return "\"" + std::string(key) + "\":" + value.dump() + ",\n";
}

std::string jsonList(std::string_view key, const std::vector<Json>& elements) {
  std::string text = "\"" + std::string(key) + "\":[";
  for (std::size_t i = 0; i < elements.size(); ++i) {
    text += (i == 0 ? "\n" : ",\n") + elements[i].dump();
  }
  return text + (elements.empty() ? "]" : "\n]");
}

}  // namespace waymark::io
