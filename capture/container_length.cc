#include "capture/container_length.h"

#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <string_view>

namespace waymark::capture {
namespace {

using Bytes = std::array<unsigned char, 16>;

class Reader {
 public:
  explicit Reader(const std::filesystem::path& path) : file_(path, std::ios::binary) {}

  // Sixteen bytes from `offset`, zeros past the end. False when there is not one.
  bool at(std::uint64_t offset, Bytes* bytes) {
    bytes->fill(0);
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(offset));
    file_.read(reinterpret_cast<char*>(bytes->data()), bytes->size());
    return file_.gcount() > 0;
  }

 private:
  std::ifstream file_;
};

bool tagAt(const Bytes& bytes, std::size_t offset, std::string_view tag) {
  return std::memcmp(bytes.data() + offset, tag.data(), tag.size()) == 0;
}

std::uint64_t bigEndian(const Bytes& bytes, std::size_t offset, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = (value << 8) | bytes[offset + i];
  return value;
}

std::uint64_t littleEndian32(const Bytes& bytes, std::size_t offset) {
  std::uint64_t value = 0;
  for (std::size_t i = 4; i-- > 0;) value = (value << 8) | bytes[offset + i];
  return value;
}

// A file is one or more RIFF chunks: "RIFF", size, form. Large files have more than one.
std::optional<std::uint64_t> riffEnd(Reader& reader, std::uint64_t file_bytes) {
  std::uint64_t end = 0;
  std::uint64_t start = 0;  // of the next chunk: they start at even offsets
  Bytes bytes;
  while (start < file_bytes && reader.at(start, &bytes) && tagAt(bytes, 0, "RIFF")) {
    const std::uint64_t size = littleEndian32(bytes, 4);
    if (size == 0) return std::nullopt;  // never filled in
    end = start + 8 + size;
    start = end + (size & 1U);
  }
  return end;
}

// A sequence of boxes: size (32 bits, or 1 and 64 bits behind the type), type.
std::optional<std::uint64_t> mp4End(Reader& reader, std::uint64_t file_bytes) {
  std::uint64_t end = 0;
  Bytes bytes;
  while (end < file_bytes && reader.at(end, &bytes)) {
    std::uint64_t size = bigEndian(bytes, 0, 4);
    if (size == 0) return std::nullopt;  // "to the end of the file"
    if (size == 1) size = bigEndian(bytes, 8, 8);
    if (size < 8) return std::nullopt;  // not a box
    end += size;
  }
  return end;
}

// EBML: an id, a size whose first set bit tells its length, the payload. Header, then Segment.
std::optional<std::uint64_t> matroskaEnd(Reader& reader) {
  constexpr std::array<std::uint64_t, 2> kElements = {0x1A45DFA3, 0x18538067};
  std::uint64_t end = 0;
  for (const std::uint64_t id : kElements) {
    Bytes bytes;
    if (!reader.at(end, &bytes) || bigEndian(bytes, 0, 4) != id || bytes[4] == 0) {
      return std::nullopt;
    }
    const auto length = static_cast<std::size_t>(std::countl_zero(bytes[4])) + 1;
    const std::uint64_t mask = (1ULL << (7 * length)) - 1;
    const std::uint64_t size = bigEndian(bytes, 4, length) & mask;
    if (size == mask) return std::nullopt;  // unknown: a live stream, or never filled in
    end += 4 + length + size;
  }
  return end;
}

}  // namespace

std::optional<ContainerLength> containerLength(const std::filesystem::path& path) {
  std::error_code error;
  ContainerLength length;
  length.file_bytes = std::filesystem::file_size(path, error);
  Reader reader(path);
  Bytes head;
  if (error || !reader.at(0, &head)) return std::nullopt;

  std::optional<std::uint64_t> end;
  if (tagAt(head, 0, "RIFF") && tagAt(head, 8, "AVI ")) {
    end = riffEnd(reader, length.file_bytes);
    length.counts_frames = true;
  } else if (tagAt(head, 4, "ftyp")) {
    end = mp4End(reader, length.file_bytes);
    length.counts_frames = true;
  } else {
    end = matroskaEnd(reader);
  }
  if (!end) return std::nullopt;
  length.declared_bytes = *end;
  return length;
}

}  // namespace waymark::capture
