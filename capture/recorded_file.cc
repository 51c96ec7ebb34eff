#include "capture/recorded_file.h"

#include <optional>
#include <utility>

#include "eventlog/log_reader.h"
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

Result<std::vector<RecordedFile>> readRecordedFiles(const std::filesystem::path& log) {
  Result<eventlog::LogReader> reader = eventlog::LogReader::open(log);
  if (!reader) return reader.error();
  std::vector<RecordedFile> files;
  for (;;) {
    const Result<std::optional<eventlog::Event>> event = reader->next();
    if (!event) return event.error();
    if (!*event || (*event)->channel != RecordedFile::kChannel) return files;
    file_t message{};
    const auto size = static_cast<int>((*event)->data.size());
    if (message.decode((*event)->data.data(), 0, size) != size) continue;
    files.push_back({std::move(message.purpose), std::move(message.name),
                     std::string(message.data.begin(), message.data.end())});
  }
}

}  // namespace waymark::capture
