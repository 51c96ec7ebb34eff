#include "capture/recorded_file.h"

#include <optional>
#include <utility>

#include "capture/eventlog/log_reader.h"
#include "capture/wire_reader.h"
#include <waymark/file_t.hpp>

namespace waymark::capture {

std::vector<std::uint8_t> encodeFile(const RecordedFile& file, std::int64_t utime) {
  file_t message{};
  message.utime = utime;
  message.purpose = file.purpose;
  message.name = file.name;
  message.data.assign(file.content.begin(), file.content.end());
  message.size = static_cast<std::int32_t>(message.data.size());
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::optional<RecordedFile> decodeFile(std::span<const std::uint8_t> bytes) {
  WireReader reader(bytes);
  if (reader.int64() != file_t::getHash()) return std::nullopt;
  (void)reader.int64();  // utime
  RecordedFile file;
  file.purpose = reader.text();
  file.name = reader.text();
  const auto content = reader.bytes(reader.count());
  file.content.assign(content.begin(), content.end());
  if (!reader.done()) return std::nullopt;
  return file;
}

Result<std::vector<RecordedFile>> readRecordedFiles(const std::filesystem::path& log) {
  Result<eventlog::LogReader> reader = eventlog::LogReader::open(log);
  if (!reader) return reader.error();
  std::vector<RecordedFile> files;
  for (;;) {
    const Result<std::optional<eventlog::Event>> event = reader->next();
    if (!event) return event.error();
    if (!*event || (*event)->channel != RecordedFile::kChannel) return files;
    if (std::optional<RecordedFile> file = decodeFile((*event)->data)) {
      files.push_back(std::move(*file));
    }
  }
}

}  // namespace waymark::capture
