#include "io/text/text_file.h"

#include <algorithm>
#include <cerrno>
#include <optional>
#include <system_error>

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

fs::path directoryOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

// The file itself, of which `path` may be a link: what is written goes where the link points, as
// with any other program. What is there and no regular file (a device, say) is not replaced.
Result<fs::path> targetOf(const fs::path& path) {
  constexpr int kMaxLinks = 40;  // as the kernel
  fs::path place = path;
  std::error_code error;
  for (int i = 0; i < kMaxLinks && fs::is_symlink(place, error); ++i) {
    const fs::path target = fs::read_symlink(place, error);
    if (error) break;
    place = target.is_absolute() ? target : directoryOf(place) / target;
  }
  const fs::file_status status = fs::symlink_status(place, error);
  if (!fs::exists(status) || fs::is_regular_file(status)) return place;
  return Error{path.string() + ": cannot be written: there is something else than a regular file"};
}

// A complete file under a temporary name, waiting for its own; gone unless it gets it.
class PendingFile {
 public:
  explicit PendingFile(fs::path path) : path_(std::move(path)) {}
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  PendingFile(PendingFile&& other) noexcept
      : path_(std::move(other.path_)),
        place_(std::move(other.place_)),
        temporary_(std::exchange(other.temporary_, std::nullopt)) {}
  PendingFile& operator=(PendingFile&&) = delete;
  ~PendingFile() {
    if (temporary_) ::unlink(temporary_->c_str());
  }

  Status write(std::string_view content) {
    Result<fs::path> place = targetOf(path_);
    if (!place) return place.error();
    place_ = std::move(place).value();
    const UniqueFd file = makeTemporary();
    if (!file) return systemError(path_, "cannot be written");
    if (!writeAll(file.get(), content) || ::fsync(file.get()) != 0) {
      return systemError(path_, "cannot be written");
    }
    return success();
  }

  Status publish() {
    if (::rename(temporary_->c_str(), place_.c_str()) != 0) {
      return systemError(path_, "cannot be written");
    }
    temporary_.reset();
    return success();
  }

  // After write(): where the file is, or will be.
  [[nodiscard]] const fs::path& place() const { return place_; }

 private:
  // A file that nobody has, whoever else may write in that directory: not one that is there, and
  // not through a link. Names that are taken are of programs that were killed.
  UniqueFd makeTemporary() {
    constexpr int kNames = 100;
    for (int i = 0; i < kNames; ++i) {
      fs::path temporary =
          directoryOf(place_) / ("." + place_.filename().string() + "." +
                                 std::to_string(::getpid()) + "." + std::to_string(i) + ".tmp");
      UniqueFd file(
          ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666));
      if (file) temporary_ = std::move(temporary);
      if (file || errno != EEXIST) return file;
    }
    return {};
  }

  fs::path path_;
  fs::path place_;
  std::optional<fs::path> temporary_;
};

// A rename is only durable once its directory is. Best effort: some file systems reject.
void syncDirectory(const fs::path& path) {
  const UniqueFd directory(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory) ::fsync(directory.get());
}

}  // namespace

Result<std::string> readTextFile(const fs::path& path, std::size_t max_bytes) {
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
    if (content.size() + static_cast<std::size_t>(count) > max_bytes) {
      return Error{path.string() + ": is larger than " + std::to_string(max_bytes >> 20U) + " MiB"};
    }
    content.append(buffer, static_cast<std::size_t>(count));
  }
}

Status writeTextFile(const fs::path& path, std::string_view content) {
  PendingFile file(path);
  if (Status written = file.write(content); !written) return written;
  if (Status published = file.publish(); !published) return published;
  syncDirectory(directoryOf(file.place()));
  return success();
}

namespace {

// A second name first, so that `path` is never without a file; where there are none, or on another
// file system, a copy.
Status keepAs(const fs::path& previous, const fs::path& path) {
  const Result<fs::path> place = targetOf(previous);
  if (!place) return place.error();
  const fs::path second_name = place->string() + ".tmp";
  ::unlink(second_name.c_str());
  if (::link(path.c_str(), second_name.c_str()) == 0) {
    if (::rename(second_name.c_str(), place->c_str()) == 0) return success();
    const Error error = systemError(previous, "cannot be written");
    ::unlink(second_name.c_str());
    return error;
  }
  if (errno == ENOENT) return success();  // there is none
  const Result<std::string> content = readTextFile(path);
  if (!content) return content.error();
  return writeTextFile(previous, *content);
}

}  // namespace

Status writeTextFileKeeping(const fs::path& path, std::string_view content,
                            const fs::path& previous) {
  PendingFile file(path);
  if (Status written = file.write(content); !written) return written;
  if (Status kept = keepAs(previous, file.place()); !kept) return kept;
  // On the disk before the old file's name is given away.
  syncDirectory(directoryOf(previous));
  if (Status published = file.publish(); !published) return published;
  syncDirectory(directoryOf(file.place()));
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
      files_(std::move(other.files_)),
      keep_in_(std::move(other.keep_in_)),
      belongs_(std::move(other.belongs_)),
      earlier_(std::move(other.earlier_)) {}

OutputDirectory::~OutputDirectory() {
  for (auto directory = created_.rbegin(); directory != created_.rend(); ++directory) {
    ::rmdir(directory->c_str());  // rejects where there are files, and so it should
  }
}

void OutputDirectory::add(std::string name, std::string content) {
  for (auto& [there, before] : files_) {
    if (there != name) continue;
    before = std::move(content);
    return;
  }
  files_.emplace_back(std::move(name), std::move(content));
}

void OutputDirectory::keepEarlierIn(std::string name,
                                    std::function<bool(const std::string&)> belongs) {
  keep_in_ = std::move(name);
  belongs_ = std::move(belongs);
}

Status OutputDirectory::moveEarlier() {
  if (keep_in_.empty()) return success();
  std::vector<std::string> moving;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(path_, error)) {
    const std::string name = entry.path().filename().string();
    const bool ours = std::ranges::any_of(files_, [&](const auto& f) { return f.first == name; });
    // Through a link somebody has chosen another place.
    if ((ours || belongs_(name)) && fs::is_regular_file(entry.symlink_status(error))) {
      moving.push_back(name);
    }
  }
  if (moving.empty()) return success();
  const fs::path place = path_ / keep_in_;
  if (::mkdir(place.c_str(), 0777) != 0 && errno != EEXIST) {
    return systemError(place, "earlier results cannot be moved there");
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(place, error)) {
    const std::string name = entry.path().filename().string();
    const bool ours = std::ranges::any_of(files_, [&](const auto& f) { return f.first == name; });
    if (ours || belongs_(name)) ::unlink(entry.path().c_str());
  }
  for (const std::string& name : moving) {
    if (::rename((path_ / name).c_str(), (place / name).c_str()) != 0) {
      return systemError(place / name, "earlier results cannot be moved there");
    }
  }
  earlier_ = place;
  return success();
}

Status OutputDirectory::commit() {
  std::vector<PendingFile> pending;
  pending.reserve(files_.size());
  for (const auto& [name, content] : files_) {
    pending.emplace_back(path_ / name);
    if (Status written = pending.back().write(content); !written) return written;
  }
  if (Status moved = moveEarlier(); !moved) return moved;
  for (PendingFile& file : pending) {
    if (Status published = file.publish(); !published) return published;
  }
  syncDirectory(path_);
  files_.clear();
  return success();
}

std::vector<std::string> OutputDirectory::commitWhatFits() {
  std::vector<std::string> missing;
  if (!moveEarlier()) {
    for (const auto& [name, content] : files_) missing.push_back(name);
    return missing;
  }
  for (const auto& [name, content] : files_) {
    PendingFile file(path_ / name);
    if (!file.write(content) || !file.publish()) missing.push_back(name);
  }
  syncDirectory(path_);
  files_.clear();
  return missing;
}

}  // namespace waymark::io
