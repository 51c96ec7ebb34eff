// Whole files in and out. What is written appears complete or not at all.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/result.h"

namespace waymark::io {

// The error names the file and the system's reason, or says that there are more bytes in it.
[[nodiscard]] Result<std::string> readTextFile(
    const std::filesystem::path& path,
    std::size_t max_bytes = std::numeric_limits<std::size_t>::max());

// Writes a temporary file beside `path`, syncs it and renames it into place. On failure `path` is
// as it was, and no temporary file stays behind. Where `path` is a link the file it points to is
// written; what is neither a regular file nor one to be is left alone, and is an error.
[[nodiscard]] Status writeTextFile(const std::filesystem::path& path, std::string_view content);

// The same, and the file that was there before stays under another name, `previous`. At every
// instant, power cuts included, at least one of the two is a whole file.
[[nodiscard]] Status writeTextFileKeeping(const std::filesystem::path& path,
                                          std::string_view content,
                                          const std::filesystem::path& previous);

// The results of one run: collected in memory, then written together. A run that fails leaves
// neither files nor a new empty directory.
class OutputDirectory {
 public:
  // Makes the directory where needed and proves that files can be made in it, so that a long run
  // does not find out at its end.
  [[nodiscard]] static Result<OutputDirectory> open(const std::filesystem::path& path);

  OutputDirectory(OutputDirectory&& other) noexcept;
  OutputDirectory& operator=(OutputDirectory&&) = delete;
  ~OutputDirectory();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  // Replaces what was added under that name.
  void add(std::string name, std::string content);
  // Results that are there already are not overwritten: before the new ones get their names, files
  // of the same names, and those that `belongs` says, move to the directory `name` in this one, in
  // place of what was moved there before.
  void keepEarlierIn(std::string name, std::function<bool(const std::string&)> belongs);
  // Where they are now; empty when there were none.
  [[nodiscard]] const std::filesystem::path& earlier() const { return earlier_; }

  // Every file is complete on disk before the first one gets its name.
  [[nodiscard]] Status commit();
  // After a commit() that failed, as the disk is full: each file that can be written, in the order
  // in which they were added. Returns the names of the others.
  [[nodiscard]] std::vector<std::string> commitWhatFits();

 private:
  explicit OutputDirectory(std::filesystem::path path) : path_(std::move(path)) {}
  [[nodiscard]] Status moveEarlier();

  std::filesystem::path path_;
  std::vector<std::filesystem::path> created_;  // directories, outermost first; removed if unused
  std::vector<std::pair<std::string, std::string>> files_;  // name, content
  std::string keep_in_;                                     // empty: earlier files are replaced
  std::function<bool(const std::string&)> belongs_;
  std::filesystem::path earlier_;
};

}  // namespace waymark::io
