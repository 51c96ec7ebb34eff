#include "capture/eventlog/log_reader.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/system_reason.h"

namespace waymark::eventlog {
namespace {

constexpr std::size_t kWindowBytes = std::size_t{4} << 20U;
constexpr std::size_t kListedDamages = 1000;
constexpr std::array<std::uint8_t, 4> kSyncBytes = {0xED, 0xA1, 0xDA, 0x01};

}  // namespace

Result<LogReader> LogReader::open(const std::filesystem::path& file) {
  UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) return Error{file.string() + ": cannot be read: " + systemReason()};
  struct stat status {};
  if (fstat(fd.get(), &status) != 0) {
    return Error{file.string() + ": cannot be read: " + systemReason()};
  }
  if (!S_ISREG(status.st_mode)) return Error{file.string() + ": is no file"};
  return LogReader(file, std::move(fd), static_cast<std::uint64_t>(status.st_size));
}

Result<std::optional<Event>> LogReader::next() {
  for (;;) {
    const Result<std::optional<Found>> found = find(position_);
    if (!found) return found.error();
    if (!*found) {
      skip(position_, size_);
      position_ = size_;
      return std::optional<Event>();
    }
    skip(position_, (*found)->offset);
    const Result<bool> good = endsWell(**found);
    if (!good) return good.error();
    if (!*good) {
      // Its sync word is not where an event begins, or its lengths are wrong.
      position_ = (*found)->offset + kSyncBytes.size();
      skip((*found)->offset, position_);
      continue;
    }
    const Header& header = (*found)->header;
    const Result<std::span<const std::uint8_t>> event =
        bytes((*found)->offset, header.eventBytes());
    if (!event) return event.error();
    position_ = (*found)->offset + header.eventBytes();
    end_of_last_ = position_;
    const auto channel = event->subspan(kHeaderBytes, header.channel_bytes);
    return std::optional<Event>(
        {.number = header.number,
         .utime = header.utime,
         .channel = {reinterpret_cast<const char*>(channel.data()), channel.size()},
         .data = event->subspan(kHeaderBytes + header.channel_bytes)});
  }
}

void LogReader::seek(std::uint64_t offset) { position_ = std::min(offset, size_); }

// Plausible: a header with possible lengths, that end within the file, and a name of printable
// characters.
Result<std::optional<Header>> LogReader::headerAt(std::uint64_t offset) {
  const auto read = bytes(offset, kHeaderBytes + kMaxChannelBytes);
  if (!read) return read.error();
  Header header;
  if (read->size() < kHeaderBytes || !readHeader(*read, &header)) return std::optional<Header>();
  if (header.eventBytes() > size_ - offset) return std::optional<Header>();
  const auto name = read->subspan(kHeaderBytes).first(header.channel_bytes);
  const bool printable =
      std::ranges::all_of(name, [](std::uint8_t c) { return c > 31 && c < 127; });
  return printable ? std::optional(header) : std::nullopt;
}

Result<std::optional<LogReader::Found>> LogReader::find(std::uint64_t from) {
  while (from + kHeaderBytes <= size_) {
    // All that has been read already: a window of its own for each event would be 4 MiB for each.
    if (const auto read = bytes(from, kHeaderBytes); !read) return read.error();
    if (from + kHeaderBytes > size_) break;
    const auto there = std::span<const std::uint8_t>(window_).subspan(
        static_cast<std::size_t>(from - window_begin_));
    const auto sync = std::search(there.begin(), there.end(), kSyncBytes.begin(), kSyncBytes.end());
    if (sync == there.end()) {
      // The word may begin in the last bytes.
      from += there.size() - (kSyncBytes.size() - 1);
      continue;
    }
    from += static_cast<std::uint64_t>(sync - there.begin());
    const Result<std::optional<Header>> header = headerAt(from);
    if (!header) return header.error();
    if (*header) return std::optional<Found>({from, **header});
    ++from;
  }
  return std::optional<Found>();
}

// By the rule in the header. Numbers tell a wrong length from a damaged neighbour: where the very
// next event begins somewhere else than this one ends, this one's length is wrong; where one or
// more are missing in between, they are what is damaged.
Result<bool> LogReader::endsWell(const Found& event) {
  const std::uint64_t end = event.offset + event.header.eventBytes();
  if (end == size_) return true;
  const Result<std::optional<Header>> neighbour = headerAt(end);
  if (!neighbour) return neighbour.error();
  if (*neighbour) return true;
  const Result<std::optional<Found>> following =
      find(event.offset + kHeaderBytes + event.header.channel_bytes);
  if (!following) return following.error();
  if (!*following) return true;  // a tail that was torn off, or zeros
  if ((*following)->offset < end) return false;
  return (*following)->header.number != event.header.number + 1;
}

void LogReader::skip(std::uint64_t from, std::uint64_t to) {
  if (from >= to) return;
  damaged_bytes_ += to - from;
  if (!damage_.empty() && damage_.back().offset + damage_.back().bytes == from) {
    damage_.back().bytes += to - from;
    return;
  }
  ++damages_;
  if (damage_.size() < kListedDamages) damage_.push_back({from, to - from});
}

Result<std::span<const std::uint8_t>> LogReader::bytes(std::uint64_t offset, std::size_t count) {
  count = static_cast<std::size_t>(std::min<std::uint64_t>(count, size_ - std::min(offset, size_)));
  const bool there = offset >= window_begin_ && offset + count <= window_begin_ + window_.size();
  if (!there) {
    const std::size_t wanted = static_cast<std::size_t>(
        std::min<std::uint64_t>(std::max(count, kWindowBytes), size_ - offset));
    window_.resize(wanted);
    window_begin_ = offset;
    for (std::size_t have = 0; have < wanted;) {
      const ssize_t got =
          pread(fd_.get(), window_.data() + have, wanted - have, static_cast<off_t>(offset + have));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) {
        return Error{file_.string() + ": byte " + std::to_string(offset + have) + ": " +
                     systemReason()};
      }
      if (got == 0) {  // somebody has cut it off meanwhile
        size_ = offset + have;
        window_.resize(have);
        count = std::min(count, have);
        break;
      }
      have += static_cast<std::size_t>(got);
    }
  }
  return std::span<const std::uint8_t>(window_).subspan(
      static_cast<std::size_t>(offset - window_begin_), count);
}

Result<std::uint64_t> endOfLastEvent(const std::filesystem::path& file) {
  Result<LogReader> reader = LogReader::open(file);
  if (!reader) return reader.error();
  const std::uint64_t size = reader->size();
  for (std::uint64_t tail = kWindowBytes;; tail *= 4) {
    reader->seek(size - std::min(tail, size));
    for (;;) {
      const Result<std::optional<Event>> event = reader->next();
      if (!event) return event.error();
      if (!*event) break;
    }
    // No event as far as that: it lies further ahead, or is larger.
    if (reader->endOfLast() > 0 || tail >= size) return reader->endOfLast();
  }
}

}  // namespace waymark::eventlog
