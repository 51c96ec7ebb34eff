#include "tools/natural/recorded_late_results.h"

#include <bit>
#include <cmath>
#include <system_error>
#include <utility>

#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/recording_name.h"
#include "capture/wire_reader.h"
#include <waymark/natural_detections_t.hpp>

namespace waymark::tools {
namespace {

namespace fs = std::filesystem;

double readDouble(capture::WireReader& reader) { return std::bit_cast<double>(reader.int64()); }

bool readBool(capture::WireReader& reader) {
  const auto byte = reader.bytes(1);
  return !byte.empty() && byte.front() != 0;
}

slam::Transform readTransform(capture::WireReader& reader) {
  Eigen::Vector3d p;
  for (double& x : p) x = readDouble(reader);
  Eigen::Quaterniond q;
  q.w() = readDouble(reader);
  q.x() = readDouble(reader);
  q.y() = readDouble(reader);
  q.z() = readDouble(reader);
  return slam::Transform::fromQuaternion(q, p);
}

slam::Matrix6d readCovariance(capture::WireReader& reader) {
  slam::Matrix6d covariance;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) covariance(row, column) = readDouble(reader);
  }
  return covariance;
}

slam::LateResult readDetection(capture::WireReader& reader) {
  slam::LateResult late;
  late.sequence = static_cast<std::uint64_t>(reader.int64());
  late.landmark = reader.int32();
  (void)reader.text();  // its name
  late.T_m_c = readTransform(reader);
  late.covariance = readCovariance(reader);
  late.decided = readBool(reader);
  late.ambiguity_ratio = readDouble(reader);
  const bool has_other = readBool(reader);
  slam::LateResult::OtherPose other;
  other.T_m_c = readTransform(reader);
  other.covariance = readCovariance(reader);
  if (has_other) late.other = other;
  return late;
}

Status readLog(const fs::path& log,
               std::map<std::uint64_t, RecordedLateResults::Recorded>* by_sequence) {
  Result<eventlog::LogReader> reader = eventlog::LogReader::open(log);
  if (!reader) return reader.error();
  for (;;) {
    const Result<std::optional<eventlog::Event>> event = reader->next();
    if (!event) return event.error();
    if (!*event) return success();
    if (auto decoded = decodeNaturalDetections((*event)->data)) {
      (*by_sequence)[decoded->sequence] = std::move(decoded->recorded);
    }
  }
}

}  // namespace

std::optional<DecodedNaturalDetections> decodeNaturalDetections(
    std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kLeastBytes = 715;  // of a detection with a name of no characters
  capture::WireReader reader(bytes);
  if (reader.int64() != natural_detections_t::getHash()) return std::nullopt;
  (void)reader.int64();  // utime
  (void)reader.int64();  // monotonic_ns
  DecodedNaturalDetections decoded;
  decoded.sequence = static_cast<std::uint64_t>(reader.int64());
  decoded.recorded.searched = readBool(reader);
  const std::int32_t count = reader.count(kLeastBytes);
  for (std::int32_t i = 0; i < count; ++i) decoded.recorded.late.push_back(readDetection(reader));
  if (!reader.done()) return std::nullopt;
  const auto is_finite = [](const slam::Transform& T_m_c, const slam::Matrix6d& covariance) {
    return T_m_c.p.allFinite() && T_m_c.R.allFinite() && covariance.allFinite();
  };
  const auto is_sound = [&](const slam::LateResult& late) {
    return is_finite(late.T_m_c, late.covariance) && !std::isnan(late.ambiguity_ratio) &&
           (!late.other || is_finite(late.other->T_m_c, late.other->covariance));
  };
  for (const slam::LateResult& late : decoded.recorded.late) {
    if (!is_sound(late)) return std::nullopt;
  }
  return decoded;
}

Result<std::map<std::uint64_t, RecordedLateResults::Recorded>> RecordedLateResults::read(
    const fs::path& log) {
  std::map<std::uint64_t, Recorded> by_sequence;
  std::error_code error;
  for (fs::path file = log; !file.empty() && fs::exists(file, error);
       file = eventlog::nextFile(file)) {
    if (const Status read = readLog(file, &by_sequence); !read) return read.error();
  }
  return by_sequence;
}

slam::FrameInput RecordedLateResults::prepare(slam::FrameInput frame, const slam::Slam& /*slam*/) {
  const auto found = by_sequence_.find(frame.time.sequence);
  if (found == by_sequence_.end()) return frame;
  frame.awaited = found->second.searched;
  frame.late = found->second.late;
  return frame;
}

}  // namespace waymark::tools
