// Event logs: the events, the frames and the files in them.
#include <array>
#include <string>

#include <sys/mman.h>
#include <unistd.h>

#include "base/unique_fd.h"
#include "capture/eventlog/log_reader.h"
#include "capture/log_source.h"
#include "capture/recorded_file.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

// A file in memory, for as long as it lives.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* data, std::size_t size) : fd_(memfd_create("log", MFD_CLOEXEC)) {
    fuzz::require(fd_ && ::write(fd_.get(), data, size) == static_cast<ssize_t>(size),
                  "there is memory for a file");
  }
  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(fd_.get()); }

 private:
  UniqueFd fd_;
};

// Every byte is handed out or told to be damaged.
void readEvents(const std::string& path, std::size_t size) {
  auto reader = eventlog::LogReader::open(path);
  fuzz::require(reader.ok(), "a file opens");
  std::size_t bytes = 0;
  for (;;) {
    const auto event = reader->next();
    fuzz::require(event.ok(), "memory can be read");
    if (!*event) break;
    bytes += eventlog::kHeaderBytes + (*event)->channel.size() + (*event)->data.size();
  }
  fuzz::require(bytes + reader->damagedBytes() == size, "no byte is lost");
}

void readFrames(const std::string& path) {
  auto source = capture::openLog(path, std::nullopt, true);
  if (!source) return fuzz::requireOneLine(source.error());
  const std::size_t pixels = static_cast<std::size_t>((*source)->info().width) *
                             static_cast<std::size_t>((*source)->info().height);
  for (;;) {
    const capture::ReadResult result = (*source)->read(std::chrono::milliseconds(0));
    if (const auto* frame = std::get_if<capture::FramePtr>(&result)) {
      const ImageView image = (*frame)->image();
      fuzz::require(static_cast<std::size_t>(image.width) * image.height == pixels,
                    "frames have the stream's size");
      continue;
    }
    if (const auto* error = std::get_if<Error>(&result)) fuzz::requireOneLine(*error);
    break;
  }
  (void)(*source)->damage();
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  (void)capture::isEventLog(file.path());
  readEvents(file.path(), size);
  readFrames(file.path());
  const auto files = capture::readRecordedFiles(file.path());
  if (!files) fuzz::requireOneLine(files.error());
  return 0;
}
