// Frames of the film as they come out of a frame source. Tests only.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "capture/open_source.h"
#include "tests/vm/uvc/scene_film.h"
#include "tests/vm/uvc/uvc_camera.h"

namespace waymark::testing {

// Few enough that an emulated machine keeps up.
inline constexpr double kFilmRate_hz = 5.0;

[[nodiscard]] inline const SceneFilm& film() { return SceneFilm::shared(); }

// The film's size and rate, in that format ("GREY").
[[nodiscard]] capture::SourceOptions filmOptions(const std::string& format);

// Plugs the camera in at the port. Its node, or an empty string and a failure of the test.
[[nodiscard]] std::string plugInAt(UvcCamera* camera, int port);

// Null, and a failure of the test, when it cannot be opened.
[[nodiscard]] std::unique_ptr<capture::FrameSource> openForTest(
    const std::string& spec, const capture::SourceOptions& options);

// The next frame; null, and a failure of the test, when there is none.
[[nodiscard]] capture::FramePtr readFrame(capture::FrameSource* source);

// The film as a decoder sees it. Make it before a camera is opened: it takes longer than frames
// wait.
class FilmPictures {
 public:
  explicit FilmPictures(const StreamMode& mode);

  // Which one is shown: the one next to it.
  struct Match {
    int picture = 0;
    int worst = 0;  // difference of all pixels, grey levels
  };
  [[nodiscard]] Match find(const ImageView& image) const;

 private:
  std::vector<Bytes> pictures_;
};

}  // namespace waymark::testing
