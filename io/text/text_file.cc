#include "io/text/text_file.h"

#include <cerrno>
#include <optional>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/system_reason.h"
#include "base/unique_fd.h"

namespace waymark::io {
namespace fs = std::filesystem;
namespace {

Error systemError(const fs::path& path, const char* what) {
  return Error{path.string() + ": " + what + ": " + systemReason()};
}

bool writeAll(int fd, std::string_view content) {
  while (!content.empty()) {
    const ssize_t written = ::write(fd, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    content.remove_prefix(static_cast<std::size_t>(written));
  }
  return true;
}

// A complete file under a temporary name, waiting for its own; gone unless it gets it.
class PendingFile {
 public:
  explicit PendingFile(fs::path path) : path_(std::move(path)) {}
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  PendingFile(PendingFile&& other) noexcept
      : path_(std::move(other.path_)), temporary_(std::exchange(other.temporary_, std::nullopt)) {}
  PendingFile& operator=(PendingFile&&) = delete;
  ~PendingFile() {
    if (temporary_) ::unlink(temporary_->c_str());
  }

  Status write(std::string_view content) {
    const fs::path directory = path_.has_parent_path() ? path_.parent_path() : fs::path(".");
    const std::string name =
        "." + path_.filename().string() + "." + std::to_string(::getpid()) + ".tmp";
    const fs::path temporary = directory / name;
    const UniqueFd file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
    if (!file) return systemError(path_, "cannot be written");
    temporary_ = temporary;
    if (!writeAll(file.get(), content) || ::fsync(file.get()) != 0) {
      return systemError(path_, "cannot be written");
    }
    return success();
  }

  Status publish() {
    if (::rename(temporary_->c_str(), path_.c_str()) != 0) {
      return systemError(path_, "cannot be written");
    }
    temporary_.reset();
    return success();
  }

 private:
  fs::path path_;
  std::optional<fs::path> temporary_;
};

// A rename is only durable once its directory is. Best effort: some file systems reject.
void syncDirectory(const fs::path& path) {
  const UniqueFd directory(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory) ::fsync(directory.get());
}

}  // namespace

Result<std::string> readTextFile(const fs::path& path) {
  // Opening a FIFO waits for who writes into it, without O_NONBLOCK.
  const UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat status {};
  if (!file || ::fstat(file.get(), &status) != 0) return systemError(path, "cannot be read");
  if (S_ISFIFO(status.st_mode))
    return Error{path.string() + ": is a FIFO, which is not waited for"};
  std::string content;
  char buffer[1 << 16];
  for (;;) {
    const ssize_t count = ::read(file.get(), buffer, sizeof buffer);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return systemError(path, "cannot be read");
    if (count == 0) return content;
    content.append(buffer, static_cast<std::size_t>(count));
  }
}

Status writeTextFile(const fs::path& path, std::string_view content) {
  PendingFile file(path);
  if (Status written = file.write(content); !written) return written;
  if (Status published = file.publish(); !published) return published;
  syncDirectory(path.has_parent_path() ? path.parent_path() : fs::path("."));
  return success();
}

Status writeTextFileKeeping(const fs::path& path, std::string_view content,
                            const fs::path& previous) {
  const fs::path directory = path.has_parent_path() ? path.parent_path() : fs::path(".");
  PendingFile file(path);
  if (Status written = file.write(content); !written) return written;
  // A second name first, so that `path` is never without a file.
  const fs::path second_name = previous.string() + ".tmp";
  ::unlink(second_name.c_str());
  if (::link(path.c_str(), second_name.c_str()) == 0) {
    if (::rename(second_name.c_str(), previous.c_str()) != 0) {
      const Error error = systemError(previous, "cannot be written");
      ::unlink(second_name.c_str());
      return error;
    }
  } else if (errno != ENOENT && ::rename(path.c_str(), previous.c_str()) != 0) {
    // Not even on a file system without second names.
    return systemError(previous, "cannot be written");
  }
  // On the disk before the old file's name is given away.
  syncDirectory(directory);
  if (Status published = file.publish(); !published) return published;
  syncDirectory(directory);
  return success();
}

Result<OutputDirectory> OutputDirectory::open(const fs::path& path) {
  OutputDirectory output(path);
  fs::path prefix;
  for (const fs::path& part : path) {
    prefix /= part;
    if (part.empty()) continue;  // a trailing slash
    if (::mkdir(prefix.c_str(), 0777) == 0) {
      output.created_.push_back(prefix);
    } else if (errno != EEXIST && errno != EISDIR) {
      return systemError(path, "output directory cannot be made");
    }
  }
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    return Error{path.string() + ": output directory cannot be made: there is a file in its place"};
  }
  PendingFile probe(path / "probe");
  if (!probe.write("")) return systemError(path, "output directory cannot be written to");
  return output;
}

OutputDirectory::OutputDirectory(OutputDirectory&& other) noexcept
    : path_(std::move(other.path_)),
      created_(std::exchange(other.created_, {})),
      files_(std::move(other.files_)) {}

OutputDirectory::~OutputDirectory() {
  for (auto directory = created_.rbegin(); directory != created_.rend(); ++directory) {
    ::rmdir(directory->c_str());  // rejects where there are files, and so it should
  }
}

void OutputDirectory::add(std::string name, std::string content) {
  files_.emplace_back(std::move(name), std::move(content));
}

Status OutputDirectory::commit() {
  std::vector<PendingFile> pending;
  pending.reserve(files_.size());
  for (const auto& [name, content] : files_) {
    pending.emplace_back(path_ / name);
    if (Status written = pending.back().write(content); !written) return written;
  }
  for (PendingFile& file : pending) {
    if (Status published = file.publish(); !published) return published;
  }
  syncDirectory(path_);
  files_.clear();
  return success();
}

}  // namespace waymark::io
