// Writes one event log so that a crash costs no more than what came since the last flush.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"

namespace waymark::eventlog {

class LogWriter {
 public:
  // Of the writes to the disk, and where they begin.
  static constexpr std::size_t kBlockBytes = std::size_t{1} << 20U;

  // The file must not be there yet. Errors name it and the reason, which after this and the other
  // calls is in errno, too.
  [[nodiscard]] static Result<LogWriter> create(const std::filesystem::path& file);
  LogWriter(LogWriter&&) = default;
  LogWriter& operator=(LogWriter&&) = default;

  // Adds an event; whole blocks go to the system at once. After an error the file ends with its
  // last whole event, and nothing more can be added. Precondition: channel of 1 to
  // kMaxChannelBytes characters, data of at most kMaxDataBytes.
  [[nodiscard]] Status append(std::int64_t utime, std::string_view channel,
                              std::span<const std::uint8_t> data);

  // What was added up to now is on the disk when this returns.
  [[nodiscard]] Status flush();

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  [[nodiscard]] std::uint64_t bytes() const { return block_begin_ + block_.size(); }
  [[nodiscard]] std::int64_t events() const { return events_; }
  // Of the file, what ends with a whole event that the system has taken. After an error that is all
  // there is.
  [[nodiscard]] std::uint64_t wholeBytes() const { return whole_end_; }
  [[nodiscard]] std::int64_t wholeEvents() const { return whole_events_; }

 private:
  LogWriter(std::filesystem::path file, UniqueFd fd);
  [[nodiscard]] Status put(std::span<const std::uint8_t> bytes);
  [[nodiscard]] Status writeBlock();
  [[nodiscard]] Error fail();

  std::filesystem::path file_;
  UniqueFd fd_;
  std::vector<std::uint8_t> block_;  // what is not in the file yet, or not all of it
  std::uint64_t block_begin_ = 0;    // where it goes, a multiple of kBlockBytes
  std::uint64_t whole_end_ = 0;      // in the file, the end of the last whole event
  std::int64_t whole_events_ = 0;    // as far as that
  std::uint64_t event_begin_ = 0;    // of the event being added
  std::int64_t events_ = 0;
};

}  // namespace waymark::eventlog
