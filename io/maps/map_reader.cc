#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "base/decimal_seconds.h"
#include "io/maps/map_file.h"
#include "io/maps/map_keys.h"
#include "io/settings/slam_settings.h"
#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "io/text/plausible.h"
#include "io/text/text_file.h"
#include "slam/camera/undistort_map.h"
#include "slam/detection/codes/dictionary.h"

namespace waymark::io {
namespace {

using slam::MarkerState;

// There are more keyframes after the last of them.
constexpr std::int64_t kLargestIndex = std::int64_t{1} << 62U;

// The upper triangle, row by row.
template <int size>
Eigen::Matrix<double, size, size> readUpperTriangle(const JsonNode& node) {
  const std::vector<double> upper = node.numbers(std::size_t{size * (size + 1) / 2});
  Eigen::Matrix<double, size, size> symmetric;
  std::size_t i = 0;
  for (Eigen::Index row = 0; row < size; ++row) {
    for (Eigen::Index column = row; column < size; ++column) {
      symmetric(row, column) = symmetric(column, row) = upper[i++];
    }
    if (symmetric(row, row) < 0.0) node.fail("must not have a negative variance");
  }
  return symmetric;
}

slam::Calibration readCamera(const JsonNode& node) {
  constexpr int kLargestImage = 1'000'000;
  slam::Calibration c;
  c.width = static_cast<int>(node.at("width").integer(1, kLargestImage));
  c.height = static_cast<int>(node.at("height").integer(1, kLargestImage));
  c.fx = node.at("fx").number();
  c.fy = node.at("fy").number();
  c.cx = node.at("cx").number();
  c.cy = node.at("cy").number();
  const std::string model = node.at("distortion_model").text();
  if (model == "equidistant") {
    c.model = slam::DistortionModel::kEquidistant;
  } else if (model != "rational_polynomial") {
    node.at("distortion_model").fail("must be \"rational_polynomial\" or \"equidistant\"");
  }
  const std::vector<double> distortion = node.at("distortion").numbers(c.distortion.size());
  std::copy(distortion.begin(), distortion.end(), c.distortion.begin());
  if (node.has(map_keys::kIntrinsicsCovariance)) {
    c.covariance = readUpperTriangle<9>(node.at(map_keys::kIntrinsicsCovariance));
  }
  if (const std::string reason = c.invalidReason(); node.good() && !reason.empty()) {
    node.fail(reason);
  }
  return c;
}

double readReadout(const JsonNode& camera) {
  if (!camera.has("readout_s")) return 0.0;
  const double readout_s = camera.at("readout_s").number();
  // Negative for a camera that hangs upside down and whose images are turned.
  if (std::abs(readout_s) > 1.0) camera.at("readout_s").fail("must be -1 to 1");
  return readout_s;
}

FieldSize readField(const JsonNode& node) {
  return {node.at("length_m").positive(), node.at("width_m").positive()};
}

MarkerState readState(const JsonNode& node) {
  const std::string name = node.text();
  for (const auto& [known, state] : map_keys::kStates) {
    if (name == known) return state;
  }
  node.fail("must be \"mapped\", \"unresolved\", \"quarantined\", \"refused\" or \"elsewhere\"");
  return MarkerState::kUnresolved;
}

// What is sent through squares and inverses must come out as a number again.
constexpr double kLargestVariance = 1e12;  // square metres, square radians
constexpr double kMaxRate_hz = 1e4;        // metres and radians per second

void checkWithin(double limit, std::span<const double> values, const JsonNode& node) {
  for (const double value : values) {
    if (node.good() && std::abs(value) > limit) node.fail("must not exceed " + roundTrip(limit));
  }
}

slam::Matrix6d readCovariance(const JsonNode& node) {
  slam::Matrix6d covariance = readUpperTriangle<6>(node);
  checkWithin(kLargestVariance, {covariance.data(), 36}, node);
  return covariance;
}

// Up to rounding, which a covariance of large and small variances may have a lot of.
bool isSemidefinite(const slam::Matrix6d& covariance) {
  constexpr double kRounding = 1e-6;
  const Eigen::SelfAdjointEigenSolver<slam::Matrix6d> solver(covariance, Eigen::EigenvaluesOnly);
  return solver.info() == Eigen::Success &&
         solver.eigenvalues()[0] >= -kRounding * std::max(solver.eigenvalues()[5], 0.0);
}

// Corners are for other programs; two truths about one marker are rejected, though.
void checkCorners(const JsonNode& node, const slam::MapMarker& marker) {
  constexpr double kRounding_m = 1e-6;
  const std::vector<JsonNode> corners = node.elements(4);
  if (!node.good()) return;
  const auto expected = marker.cornersInWorld();
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d corner = corners[k].point3();
    if (node.good() && !((corner - expected[k]).norm() < kRounding_m)) {
      node.fail("are not where T_w_m and size put them; mend or leave out");
    }
  }
}

// Reads one file into one map.
class MapReader {
 public:
  explicit MapReader(const JsonNode& root) : root_(root) {}

  MapFile read() {
    MapFile file;
    readDictionary(&file.map);
    if (root_.has("camera") && !root_.at("camera").json().is_null()) {
      file.camera = readCamera(root_.at("camera"));
      file.readout_s = readReadout(root_.at("camera"));
    }
    if (root_.has("field")) file.field = readField(root_.at("field"));
    for (const char* list : {"markers", "unposed_markers"}) {
      for (const JsonNode& node : root_.at(list).elements()) {
        const bool posed = std::string_view(list) == "markers";
        slam::Map* const piece = pieceOf(node, &file);
        readMarker(node, posed, piece);
        if (posed && root_.good()) checkPlacedOnce(node, *piece, file);
        if (!root_.good()) return file;
      }
    }
    if (root_.has("natural_markers")) {
      for (const JsonNode& node : root_.at("natural_markers").elements()) {
        readPicture(node, pieceOf(node, &file));
        if (!root_.good()) return file;
      }
    }
    const std::vector<JsonNode> keyframes = root_.at("keyframes").elements();
    if (!keyframes.empty() && !file.camera) root_.at("camera").fail("must be there: keyframes are");
    if (!root_.good() || !file.camera) return file;
    const slam::CameraModel camera(*file.camera);
    for (const JsonNode& node : keyframes) {
      readKeyframe(node, camera, pieceOf(node, &file));
      if (!root_.good()) return file;
    }
    // The corners of a rolling shutter follow from the poses, too.
    if (file.readout_s == 0.0) return file;
    undistortAgain(camera, &file);
    return file;
  }

 private:
  // The first piece that is named is the file's map.
  slam::Map* pieceOf(const JsonNode& node, MapFile* file) {
    constexpr int kMostPieces = 1'000'000'000;
    const int piece =
        node.has("piece") ? static_cast<int>(node.at("piece").integer(0, kMostPieces)) : 0;
    if (!has_piece_) file->map.piece = piece;
    has_piece_ = true;
    if (file->map.piece == piece) return &file->map;
    const auto known = std::ranges::find(file->other_pieces, piece, &slam::Map::piece);
    if (known != file->other_pieces.end()) return &*known;
    slam::Map& other = file->other_pieces.emplace_back();
    other.dictionary = file->map.dictionary;
    other.piece = piece;
    return &other;
  }

  // The last marker read; another piece must not have a place for it, too.
  static void checkPlacedOnce(const JsonNode& node, const slam::Map& piece, const MapFile& file) {
    const int id = static_cast<int>(node.at("id").integer(0, std::numeric_limits<int>::max()));
    const auto places = [&](const slam::Map& other) {
      return &other != &piece && other.findPosed(id) != nullptr;
    };
    if (places(file.map) || std::ranges::any_of(file.other_pieces, places)) {
      node.at("id").fail("the marker " + std::to_string(id) + " has a pose in two pieces");
    }
  }

  void readDictionary(slam::Map* map) {
    map->dictionary = root_.at("dictionary").text();
    if (!root_.good()) return;
    const auto dictionary = slam::Dictionary::byName(map->dictionary);
    if (dictionary) largest_id_ = dictionary->size() - 1;
    if (!dictionary) root_.at("dictionary").fail(*validateDictionary(map->dictionary));
  }

  void readMarker(const JsonNode& node, bool posed, slam::Map* map) const {
    const int id = static_cast<int>(node.at("id").integer(0, largest_id_));
    const double size_m = node.at("size").positive();
    if (node.good() && !isSize(size_m)) node.at("size").fail(kSizes);
    if (node.at("dictionary").text() != map->dictionary) {
      node.at("dictionary").fail("is not the map's, \"" + map->dictionary + "\"");
    }
    if (map->find(id) != nullptr) {
      node.at("id").fail("the marker " + std::to_string(id) + " occurs twice");
    }
    if (!node.good()) return;
    slam::MapMarker marker;
    marker.id = id;
    marker.size_m = size_m;
    readPlace(node, posed, std::move(marker), map);
  }

  void readPicture(const JsonNode& node, slam::Map* map) const {
    slam::MapMarker marker;
    marker.picture = node.at("name").text();
    marker.id = slam::pictureId(marker.picture);
    marker.size_m = node.at("width").positive();
    marker.height_m = node.at("height").positive();
    if (!node.good()) return;
    if (marker.picture.empty()) node.at("name").fail("must not be empty");
    if (node.at("id").integer(0, std::numeric_limits<int>::max()) != marker.id && node.good()) {
      node.at("id").fail("is not the one that comes from the name, " + std::to_string(marker.id));
    }
    if (!isSize(marker.size_m)) node.at("width").fail(kSizes);
    if (!isSize(marker.height_m)) node.at("height").fail(kSizes);
    if (map->find(marker.id) != nullptr) node.at("name").fail("occurs twice");
    if (!node.good()) return;
    readPlace(node, node.has("T_w_m"), std::move(marker), map);
  }

  // State and poses of a marker whose id and size are known, and so into the map.
  static void readPlace(const JsonNode& node, bool posed, slam::MapMarker marker, slam::Map* map) {
    marker.state = posed ? MarkerState::kMapped : MarkerState::kUnresolved;
    if (node.has("state")) marker.state = readState(node.at("state"));
    if (posed) marker.T_w_m = node.at("T_w_m").transform();
    if (posed && node.has("corners")) checkCorners(node.at("corners"), marker);
    if (posed != (marker.state == MarkerState::kMapped)) {
      node.at("state").fail(posed ? "must be \"mapped\" where there is a pose"
                                  : "must not be \"mapped\" where there is no pose");
    }
    if (node.has("other_T_w_m")) marker.other_T_w_m = node.at("other_T_w_m").transform();
    readCovariances(node, &marker);
    if (node.has("former_poses")) {
      for (const JsonNode& pose : node.at("former_poses").elements()) {
        marker.former_poses.push_back(pose.transform());
      }
    }
    if (node.good() && !map->putMarker(marker)) {
      node.at("other_T_w_m").fail("must not be there without a first pose");
    }
  }

  // Until 0.1.0 "covariance" was what is now the one given the keyframes, and stood alone.
  static void readCovariances(const JsonNode& node, slam::MapMarker* marker) {
    const bool has_both = node.has(map_keys::kGivenKeyframes);
    if (has_both) marker->covariance = readCovariance(node.at(map_keys::kGivenKeyframes));
    if (!node.has("covariance")) return;
    const slam::Matrix6d covariance = readCovariance(node.at("covariance"));
    if (!has_both) {
      marker->covariance = covariance;
      return;
    }
    marker->world_covariance = covariance;
    if (node.good() && !isSemidefinite(covariance)) {
      node.at("covariance").fail("must not have a negative variance in any direction");
    }
  }

  void readKeyframe(const JsonNode& node, const slam::CameraModel& camera, slam::Map* map) {
    slam::Keyframe keyframe;
    keyframe.id = node.at("index").integer(0, kLargestIndex);
    const slam::KeyframeId last = map->keyframes().empty() ? -1 : map->keyframes().rbegin()->first;
    if (node.good() && keyframe.id <= last) {
      node.at("index").fail("must be larger than the one before, " + std::to_string(last));
    }
    keyframe.sequence = node.at("sequence").natural();
    keyframe.monotonic_ns = node.at("time_ns").integer(-kFarthest_ns, kFarthest_ns);
    keyframe.T_w_c = node.at("T_w_c").transform();
    if (node.has("twist")) {
      const std::vector<double> twist = node.at("twist").numbers(6);
      checkWithin(kMaxRate_hz, twist, node.at("twist"));
      std::copy(twist.begin(), twist.end(), keyframe.twist.data());
    }
    if (node.has("links")) keyframe.links = readLinks(node.at("links"), *map);
    std::vector<slam::MarkerDetection> all;
    for (const JsonNode& detection : node.at("detections").elements()) {
      all.push_back(readDetection(detection, camera, *map));
      if (all.size() > 1 && all.back().id <= all[all.size() - 2].id) {
        detection.at("id").fail("must be larger than the one before; no marker is seen twice");
      }
      if (!node.good()) return;
    }
    keyframe.detections = std::move(all);
    if (node.good()) (void)map->addKeyframe(std::move(keyframe));
  }

  std::vector<slam::MarkerLink> readLinks(const JsonNode& node, const slam::Map& map) const {
    std::vector<slam::MarkerLink> links;
    for (const JsonNode& element : node.elements()) {
      slam::MarkerLink link;
      link.marker =
          static_cast<int>(element.at("marker").integer(0, std::numeric_limits<int>::max()));
      if (node.good() && map.findPosed(link.marker) == nullptr) {
        element.at("marker").fail("the map has no marker " + std::to_string(link.marker) +
                                  " with a pose");
      }
      if (node.good() && !links.empty() && link.marker <= links.back().marker) {
        element.at("marker").fail("must be larger than the one before; two have one link");
      }
      link.T_c_m = element.at("T_c_m").transform();
      link.covariance = readCovariance(element.at("covariance"));
      if (!node.good()) break;
      if (link.covariance.llt().info() != Eigen::Success) {
        element.at("covariance").fail("must be positive definite");
      }
      links.push_back(link);
    }
    return links;
  }

  slam::MarkerDetection readDetection(const JsonNode& node, const slam::CameraModel& camera,
                                      const slam::Map& map) const {
    slam::MarkerDetection detection;
    detection.id = static_cast<int>(node.at("id").integer(0, largest_id_));
    if (node.good() && map.find(detection.id) == nullptr) {
      node.at("id").fail("the map has no marker " + std::to_string(detection.id));
    }
    detection.hamming = static_cast<int>(node.at("hamming").integer(0, 64));
    const std::vector<JsonNode> pixels = node.at("pixels").elements(4);
    const std::vector<JsonNode> covariances = node.at("normalised_covariance").elements(4);
    for (std::size_t k = 0; k < 4 && node.good(); ++k) {
      detection.pixels[k] = pixels[k].point2();
      const auto normalized = camera.undistort(detection.pixels[k]);
      if (normalized) detection.normalized[k] = *normalized;
      if (!normalized) pixels[k].fail("the camera's lens cannot see there");
      const std::vector<double> v = covariances[k].numbers(3);
      detection.covariance[k] << v[0], v[1], v[1], v[2];
      if (node.good() && !isCovariance(v[0], v[1], v[2])) {
        covariances[k].fail("must be xx, xy, yy of a positive definite matrix");
      }
    }
    return detection;
  }

  const JsonNode& root_;
  int largest_id_ = 0;
  bool has_piece_ = false;
};

constexpr std::array<std::string_view, 10> kKeys = {
    "format", "version", "checksum",        "dictionary",      "camera",
    "field",  "markers", "unposed_markers", "natural_markers", "keyframes"};

void checkHead(const JsonNode& root) {
  if (root.at("format").text() != map_keys::kFormat) {
    root.at("format").fail("must be \"" + std::string(map_keys::kFormat) + "\"");
  }
  const JsonNode version = root.at("version");
  if (root.good() && version.json() != map_keys::kVersion) {
    version.fail("is " + version.json().dump() + ", this program reads " +
                 std::to_string(map_keys::kVersion));
  }
  if (!root.good()) return;
  for (const auto& [key, value] : root.json().items()) {
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end()) {
      root.at(key.c_str()).fail("unknown key");
    }
  }
}

void checkChecksum(const JsonNode& node, const std::string& text) {
  const std::string stored = node.text();
  const std::string line = map_keys::checksumLine(stored);
  const std::size_t begin = text.find(line);
  if (begin != text.npos) {
    const std::string_view all = text;
    if (map_keys::checksum(all.substr(0, begin), all.substr(begin + line.size())) == stored) return;
  }
  node.fail("does not match: the file is damaged, or was edited; take the line out to use it");
}

}  // namespace

void undistortAgain(const slam::CameraModel& camera, MapFile* file) {
  slam::undistortAgain(camera, file->readout_s, &file->map);
  for (slam::Map& piece : file->other_pieces) {
    slam::undistortAgain(camera, file->readout_s, &piece);
  }
}

Result<MapFile> parseMap(const std::string& text, const std::filesystem::path& file) {
  const Result<Json> json = parseJson(text, file.string());
  if (!json) return json.error();
  std::string fault;
  const JsonNode root(*json, &fault);
  checkHead(root);
  const bool has_checksum = root.has("checksum");
  if (root.good() && has_checksum) checkChecksum(root.at("checksum"), text);
  MapFile result;
  if (root.good()) result = MapReader(root).read();
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  result.has_checksum = has_checksum;
  return result;
}

Result<MapFile> readMap(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path, kMaxMapBytes);
  if (!text) return text.error();
  return parseMap(*text, path);
}

}  // namespace waymark::io
