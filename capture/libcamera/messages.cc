#include <cstdlib>
#include <iostream>
#include <memory>
#include <ostream>
#include <streambuf>
#include <string_view>
#include <utility>

#include <libcamera/logging.h>

#include "capture/libcamera/libcamera_source.h"
#include "capture/libcamera/manager.h"

namespace waymark::capture {
namespace {

// Keeps nothing, so that several threads may write at once: libcamera writes each message whole.
class SinkBuffer final : public std::streambuf {
 public:
  explicit SinkBuffer(LibcameraMessages::Sink sink) : sink_(std::move(sink)) {}

 protected:
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    std::string_view rest(text, static_cast<std::size_t>(size));
    while (!rest.empty()) {
      const std::size_t end = rest.find('\n');
      if (const std::string_view line = rest.substr(0, end); !line.empty()) sink_(line);
      rest = end == rest.npos ? std::string_view() : rest.substr(end + 1);
    }
    return size;
  }
  int_type overflow(int_type c) override {
    const char one = traits_type::to_char_type(c);
    if (!traits_type::eq_int_type(c, traits_type::eof())) (void)xsputn(&one, 1);
    return traits_type::not_eof(c);
  }

 private:
  const LibcameraMessages::Sink sink_;
};

}  // namespace

struct LibcameraMessages::Output {
  explicit Output(Sink sink) : buffer(std::move(sink)), stream(&buffer) {}

  SinkBuffer buffer;
  std::ostream stream;
};

LibcameraMessages::LibcameraMessages(Sink sink) {
  if (std::getenv("LIBCAMERA_LOG_FILE") != nullptr) return;
  libcam::quietUnlessAsked();  // read when libcamera's log begins, which is now
  auto output = std::make_unique<Output>(std::move(sink));
  if (libcamera::logSetStream(&output->stream, /*color=*/false) == 0) output_ = std::move(output);
}

LibcameraMessages::~LibcameraMessages() {
  if (output_) (void)libcamera::logSetStream(&std::cerr, /*color=*/false);
}

}  // namespace waymark::capture
