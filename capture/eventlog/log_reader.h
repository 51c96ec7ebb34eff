// Reads event logs that anything may have happened to: cut off in the middle, filled up with zeros
// by a file system after a power cut, bits flipped, lengths absurd. What is whole is handed out,
// and what is not is skipped and told.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"
#include "capture/eventlog/event.h"

namespace waymark::eventlog {

// A stretch of a log that holds no whole event.
struct Damage {
  std::uint64_t offset = 0;  // bytes from the beginning
  std::uint64_t bytes = 0;
};

class LogReader {
 public:
  // The error names the file and the reason. An empty file is a log without events.
  [[nodiscard]] static Result<LogReader> open(const std::filesystem::path& file);

  // The next whole event; what it refers to is good until the next call. Empty at the end of the
  // file. An error (the disk cannot be read) names the file and the place.
  //
  // A wrong length is found by what follows: an event is handed out only where the next one, or the
  // end, or nothing but damage begins at its end. Data that are merely altered are not noticed
  // here.
  [[nodiscard]] Result<std::optional<Event>> next();

  // Goes on at this byte, wherever in an event that is: with the next whole one.
  void seek(std::uint64_t offset);

  // What was skipped up to now, in order; of very many only the first are listed, but all counted.
  [[nodiscard]] const std::vector<Damage>& damage() const { return damage_; }
  [[nodiscard]] std::uint64_t damages() const { return damages_; }
  [[nodiscard]] std::uint64_t damagedBytes() const { return damaged_bytes_; }
  // Where the last event handed out ends: what comes after it may be cut off.
  [[nodiscard]] std::uint64_t endOfLast() const { return end_of_last_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  LogReader(std::filesystem::path file, UniqueFd fd, std::uint64_t size)
      : file_(std::move(file)), fd_(std::move(fd)), size_(size) {}

  // Where the next plausible event begins, at or after `from`; size_ when there is none.
  struct Found {
    std::uint64_t offset = 0;
    Header header;
  };
  [[nodiscard]] Result<std::optional<Found>> find(std::uint64_t from);
  [[nodiscard]] Result<std::optional<Header>> headerAt(std::uint64_t offset);
  [[nodiscard]] Result<bool> endsWell(const Found& event);
  void skip(std::uint64_t from, std::uint64_t to);

  // `count` bytes of the file, fewer at its end; good until the next call.
  [[nodiscard]] Result<std::span<const std::uint8_t>> bytes(std::uint64_t offset,
                                                            std::size_t count);

  std::filesystem::path file_;
  UniqueFd fd_;
  std::uint64_t size_ = 0;
  std::uint64_t position_ = 0;
  std::uint64_t end_of_last_ = 0;
  std::vector<std::uint8_t> window_;  // a part of the file
  std::uint64_t window_begin_ = 0;
  std::vector<Damage> damage_;
  std::uint64_t damages_ = 0;
  std::uint64_t damaged_bytes_ = 0;
};

// Where the last whole event of a log ends; found from the log's end, of which no more is read than
// that takes. 0 when there is none.
[[nodiscard]] Result<std::uint64_t> endOfLastEvent(const std::filesystem::path& file);

}  // namespace waymark::eventlog
