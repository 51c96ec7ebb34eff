// Sole owner of a file descriptor.
#pragma once

#include <cerrno>
#include <utility>

#include <unistd.h>

namespace waymark {

class UniqueFd {
 public:
  UniqueFd() = default;
  explicit UniqueFd(int fd) : fd_(fd) {}
  UniqueFd(UniqueFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  UniqueFd& operator=(UniqueFd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  // Leaves errno as it was, so that it still tells of the call that failed.
  ~UniqueFd() {
    const int kept = errno;
    if (fd_ >= 0) close(fd_);
    errno = kept;
  }

  [[nodiscard]] int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

}  // namespace waymark
