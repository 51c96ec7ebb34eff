#include "daemon/publish/natural_messages.h"

#include <algorithm>
#include <cstddef>

#include "daemon/publish/message_fields.h"
#include "io/text/json_node.h"

namespace waymark::daemon {
namespace {

constexpr int kPicturesPerPiece = 120;  // of some 370 bytes and a name

// Empty for one that is in a map that was read, and not among those configured.
slam::PicturePrint printOf(int id, const PrintsById& prints) {
  const auto found = prints.find(id);
  return found == prints.end() ? slam::PicturePrint{} : found->second;
}

}  // namespace

PrintsById byId(const std::vector<slam::PicturePrint>& prints) {
  PrintsById table;
  for (const slam::PicturePrint& print : prints) table[slam::pictureId(print.name)] = print;
  return table;
}

void fillNaturalDetections(const FrameRecord& record, const PrintsById& prints,
                           natural_detections_t& message) {
  message.utime = record.stamp.utime;
  message.monotonic_ns = record.stamp.monotonic_ns;
  message.sequence = static_cast<std::int64_t>(record.stamp.sequence);
  message.searched = record.searched ? 1 : 0;
  message.count = static_cast<std::int32_t>(record.heard);
  message.detections.resize(record.heard);
  for (std::size_t i = 0; i < record.heard; ++i) {
    const slam::LateResult& late = record.late[i];
    natural_detection_t& out = message.detections[i];
    out.sequence = static_cast<std::int64_t>(late.sequence);
    out.id = late.landmark;
    out.name = printOf(late.landmark, prints).name;
    put(late.T_m_c.p, out.p_m_c);
    put(io::stableQuaternion(late.T_m_c.R), out.q_m_c);
    put(late.covariance, out.covariance);
    out.decided = late.decided ? 1 : 0;
    out.ambiguity_ratio = late.ambiguity_ratio;
    out.has_other = late.other ? 1 : 0;
    const slam::LateResult::OtherPose other = late.other.value_or(slam::LateResult::OtherPose{});
    put(other.T_m_c.p, out.other_p_m_c);
    put(io::stableQuaternion(other.T_m_c.R), out.other_q_m_c);
    put(other.covariance, out.other_covariance);
  }
}

int naturalPieceCount(const MapSnapshot& map) {
  const int pictures = static_cast<int>(map.pictures.size());
  return std::max(1, (pictures + kPicturesPerPiece - 1) / kPicturesPerPiece);
}

void fillNaturalMapPiece(const MapSnapshot& map, const PrintsById& prints, std::int64_t revision,
                         int piece, natural_map_t& message) {
  const std::size_t begin = static_cast<std::size_t>(piece) * kPicturesPerPiece;
  const std::size_t end = std::min(begin + kPicturesPerPiece, map.pictures.size());
  message.utime = map.stamp.utime;
  message.monotonic_ns = map.stamp.monotonic_ns;
  message.revision = revision;
  message.piece = piece;
  message.piece_count = naturalPieceCount(map);
  message.marker_count = static_cast<std::int32_t>(map.pictures.size());
  message.count = static_cast<std::int32_t>(end - begin);
  message.markers.resize(end - begin);
  for (std::size_t i = begin; i < end; ++i) {
    const MapSnapshot::Marker& picture = map.pictures[i];
    const slam::PicturePrint print = printOf(picture.id, prints);
    natural_marker_t& out = message.markers[i - begin];
    out.id = picture.id;
    out.name = print.name;
    out.width = picture.size_m;
    out.height = print.height_m;
    put(picture.T_w_m.p, out.p_w_m);
    put(picture.T_w_m.quaternion(), out.q_w_m);
    put(picture.covariance, out.covariance);
    out.map_piece = picture.map_piece;
  }
}

}  // namespace waymark::daemon
