// Strict reading of JSON files: every value knows where it stands, and the first fault says so.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "base/result.h"
#include "slam/geometry/transform.h"

namespace waymark::io {

// Keeps the order of insertion, so that what is written reads in its author's order.
using Json = nlohmann::ordered_json;

// The error says "FILE:LINE:COLUMN: reason"; text that ends too early is called cut off.
[[nodiscard]] Result<Json> parseJson(const std::string& text, const std::string& file);

// One value of a file under reading. All nodes of a file share one fault: the first is kept, reads
// go on with harmless values, and the caller looks once, at the end. The JSON and the fault must
// outlive the node.
class JsonNode {
 public:
  JsonNode(const Json& root, std::string* fault) : json_(&root), fault_(fault) {}

  [[nodiscard]] bool has(const char* key) const;
  // A member of an object; a fault when it is missing.
  [[nodiscard]] JsonNode at(const char* key) const;
  // The elements of a list; a fault when it is none, or has another length than asked for.
  [[nodiscard]] std::vector<JsonNode> elements() const;
  [[nodiscard]] std::vector<JsonNode> elements(std::size_t count) const;

  [[nodiscard]] double number() const;    // finite
  [[nodiscard]] double positive() const;  // and above 0
  [[nodiscard]] std::int64_t integer(std::int64_t least, std::int64_t most) const;
  [[nodiscard]] std::uint64_t natural() const;  // from 0 on
  [[nodiscard]] std::string text() const;       // not empty
  [[nodiscard]] std::vector<double> numbers(std::size_t count) const;
  [[nodiscard]] Eigen::Vector2d point2() const;  // [x, y]
  [[nodiscard]] Eigen::Vector3d point3() const;  // [x, y, z]
  // [w, x, y, z] with length 1; one that is a little off (1e-6) is normalized.
  [[nodiscard]] Eigen::Quaterniond unitQuaternion() const;
  // {"p": [x, y, z], "q": [w, x, y, z]}, at most 100 000 km away
  [[nodiscard]] slam::Transform transform() const;

  // "markers[3].T_w_m.q: reason".
  void fail(const std::string& reason) const;
  [[nodiscard]] bool good() const { return fault_->empty(); }
  [[nodiscard]] const Json& json() const { return *json_; }

 private:
  JsonNode(const Json& json, std::string place, std::string* fault)
      : json_(&json), place_(std::move(place)), fault_(fault) {}

  const Json* json_;
  std::string place_;
  std::string* fault_;
};

// What is kept of an orientation in a file: a quaternion whose rotation matrix gives this very
// quaternion again, so that reading and writing a file any number of times changes nothing. w >= 0.
[[nodiscard]] Eigen::Quaterniond stableQuaternion(const Eigen::Matrix3d& R);
// The transform that is read back.
[[nodiscard]] slam::Transform asRead(const slam::Transform& T);

[[nodiscard]] Json toJson(const Eigen::Vector2d& v);
[[nodiscard]] Json toJson(const Eigen::Vector3d& v);
[[nodiscard]] Json toJson(const slam::Transform& T);

// `"key":value,` with a newline, for files of one line a value.
[[nodiscard]] std::string jsonField(std::string_view key, const Json& value);
// `"key":[` and one element a line: readable, and differences between two files stay local.
[[nodiscard]] std::string jsonList(std::string_view key, const std::vector<Json>& elements);

}  // namespace waymark::io
