#include "capture/eventlog/log_writer.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

#include "base/system_reason.h"
#include "capture/eventlog/event.h"

namespace waymark::eventlog {

Result<LogWriter> LogWriter::create(const std::filesystem::path& file) {
  UniqueFd fd(open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!fd) return Error{file.string() + ": cannot be written: " + systemReason()};
  return LogWriter(file, std::move(fd));
}

LogWriter::LogWriter(std::filesystem::path file, UniqueFd fd)
    : file_(std::move(file)), fd_(std::move(fd)) {
  block_.reserve(kBlockBytes);
}

Status LogWriter::append(std::int64_t utime, std::string_view channel,
                         std::span<const std::uint8_t> data) {
  if (!fd_) return Error{file_.string() + ": was closed by an error"};
  event_begin_ = bytes();
  std::array<std::uint8_t, kHeaderBytes> header{};
  writeHeader({.number = events_,
               .utime = utime,
               .channel_bytes = channel.size(),
               .data_bytes = data.size()},
              header);
  const auto* name = reinterpret_cast<const std::uint8_t*>(channel.data());
  for (const std::span<const std::uint8_t> part :
       {std::span<const std::uint8_t>(header), std::span(name, channel.size()), data}) {
    if (Status added = put(part); !added) return added;
  }
  ++events_;
  return success();
}

Status LogWriter::put(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const std::size_t count = std::min(bytes.size(), kBlockBytes - block_.size());
    block_.insert(block_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
    bytes = bytes.subspan(count);
    if (block_.size() < kBlockBytes) continue;
    if (Status written = writeBlock(); !written) return written;
    whole_end_ = event_begin_;
    whole_events_ = events_;
    block_begin_ += kBlockBytes;
    block_.clear();
  }
  return success();
}

// The block stays: until it is full it is written again from its beginning, so that every write
// begins where a block of the disk does.
Status LogWriter::writeBlock() {
  for (std::size_t done = 0; done < block_.size();) {
    const ssize_t count = pwrite(fd_.get(), block_.data() + done, block_.size() - done,
                                 static_cast<off_t>(block_begin_ + done));
    if (count < 0 && errno == EINTR) continue;
    if (count == 0) errno = EIO;  // nothing of it, and no reason
    if (count <= 0) return fail();
    done += static_cast<std::size_t>(count);
  }
  return success();
}

Status LogWriter::flush() {
  if (!fd_) return Error{file_.string() + ": was closed by an error"};
  if (Status written = writeBlock(); !written) return written;
  if (fdatasync(fd_.get()) != 0) return fail();
  whole_end_ = bytes();
  whole_events_ = events_;
  return success();
}

Error LogWriter::fail() {
  const int cause = errno;
  Error error{file_.string() + ": byte " + std::to_string(block_begin_) +
              ": cannot be written: " + systemReason()};
  // A reader would find the end all the same; others do not.
  if (ftruncate(fd_.get(), static_cast<off_t>(whole_end_)) != 0) {
    error.message += ", nor cut to its last whole event: " + systemReason();
  }
  fd_ = UniqueFd();
  errno = cause;
  return error;
}

}  // namespace waymark::eventlog
