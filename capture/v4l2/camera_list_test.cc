#include "capture/v4l2/camera_list.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::capture::v4l2 {
namespace {

Camera camera(std::string path, std::string bus, std::string serial, std::string card = "C920") {
  return {.path = std::move(path),
          .links = {},
          .card = {.driver = "uvcvideo", .name = std::move(card), .bus = std::move(bus)},
          .serial = std::move(serial)};
}

CameraName named(const std::string& text) {
  const Result<CameraName> name = parseCameraName(text);
  EXPECT_TRUE(name.ok()) << name.error().message;
  return name.ok() ? *name : CameraName{};
}

std::string found(const std::string& name, const std::vector<Camera>& cameras,
                  const std::optional<CameraIdentity>& known = {}) {
  const Result<Camera> camera = findCamera(named(name), known, cameras);
  return camera.ok() ? camera->path : camera.error().message;
}

TEST(CameraName, IsAPathOrAProperty) {
  EXPECT_EQ(named("/dev/video2").text, "/dev/video2");
  EXPECT_EQ(named("serial=A1").kind, CameraName::Kind::kSerial);
  EXPECT_EQ(named("card=HD Webcam").text, "HD Webcam");
  EXPECT_EQ(named("bus=usb-1").kind, CameraName::Kind::kBus);
  for (const char* wrong : {"", "video0", "serial=", "name=x"}) {
    EXPECT_FALSE(parseCameraName(wrong).ok()) << wrong;
  }
}

TEST(FindCamera, ByEveryName) {
  const std::vector<Camera> cameras = {camera("/dev/video0", "usb-1", "A"),
                                       camera("/dev/video2", "usb-2", "B", "Other")};
  EXPECT_EQ(found("/dev/video2", cameras), "/dev/video2");
  EXPECT_EQ(found("serial=A", cameras), "/dev/video0");
  EXPECT_EQ(found("card=Other", cameras), "/dev/video2");
  EXPECT_EQ(found("bus=usb-1", cameras), "/dev/video0");
  EXPECT_EQ(found("serial=C", cameras),
            "v4l2:serial=C: there is no such camera, but /dev/video0 (C920, bus=usb-1, serial=A); "
            "/dev/video2 (Other, bus=usb-2, serial=B)");
  EXPECT_EQ(found("/dev/video0", {}), "v4l2:/dev/video0: there is no such camera, nor any other");
}

TEST(FindCamera, NeverGuessesBetweenTwo) {
  const std::vector<Camera> twins = {camera("/dev/video0", "usb-1", "same"),
                                     camera("/dev/video2", "usb-2", "same")};
  EXPECT_EQ(found("card=C920", twins),
            "v4l2:card=C920: is any of /dev/video0 (C920, bus=usb-1, serial=same); /dev/video2 "
            "(C920, bus=usb-2, serial=same); name it by its bus= or its link in /dev/v4l/by-path");
}

TEST(FindCamera, TheFirstOfSeveralDevicesOfOnePiece) {
  std::vector<Camera> devices = {camera("/dev/video1", "platform:isp", ""),
                                 camera("/dev/video0", "platform:isp", "")};
  devices[0].index = 1;
  EXPECT_EQ(found("bus=platform:isp", devices), "/dev/video0");
}

// Two of a kind, unplugged and plugged in again in the other order: their numbers have changed.
TEST(FindCamera, ItIsTheOneThatWasOpened) {
  const std::vector<Camera> before = {camera("/dev/video0", "usb-1", "same"),
                                      camera("/dev/video2", "usb-2", "same")};
  const CameraIdentity known = CameraIdentity::of(before[0], before);
  EXPECT_FALSE(known.serial_is_unique);
  const std::vector<Camera> after = {camera("/dev/video0", "usb-2", "same"),
                                     camera("/dev/video2", "usb-1", "same")};
  EXPECT_EQ(found("/dev/video0", after, known), "/dev/video2");
  // The other one alone is not it, whatever its number.
  const std::vector<Camera> other = {camera("/dev/video0", "usb-2", "same")};
  EXPECT_EQ(found("/dev/video0", other, known),
            "v4l2:/dev/video0: 'C920' is no longer at usb-1; there is /dev/video0 (C920, "
            "bus=usb-2, serial=same)");
}

TEST(FindCamera, AUniqueSerialIsFoundAtAnotherPlace) {
  const std::vector<Camera> before = {camera("/dev/video0", "usb-1", "A"),
                                      camera("/dev/video2", "usb-2", "B")};
  const CameraIdentity known = CameraIdentity::of(before[0], before);
  const std::vector<Camera> after = {camera("/dev/video1", "usb-7", "A"), before[1]};
  EXPECT_EQ(found("/dev/video0", after, known), "/dev/video1");
}

TEST(FindCamera, ACameraThatIsNamedByItsPlaceIsThereOrNowhere) {
  const std::vector<Camera> before = {camera("/dev/video0", "usb-1", "A")};
  const CameraIdentity known = CameraIdentity::of(before[0], before);
  EXPECT_TRUE(known.serial_is_unique);
  const std::vector<Camera> elsewhere = {camera("/dev/video0", "usb-2", "A")};
  EXPECT_EQ(found("/dev/video0", elsewhere, known), "/dev/video0");
  for (const char* name : {"bus=usb-1", "/dev/v4l/by-path/usb-1-video-index0"}) {
    EXPECT_EQ(found(name, elsewhere, known),
              "v4l2:" + std::string(name) +
                  ": 'C920' is no longer at usb-1; there is /dev/video0 (C920, bus=usb-2, "
                  "serial=A)");
  }
}

// Its twin is not plugged in at the moment, but it may be the next one to come.
TEST(FindCamera, ASerialThatAnotherOneHadStaysShared) {
  const std::vector<Camera> both = {camera("/dev/video0", "usb-1", "same"),
                                    camera("/dev/video2", "usb-2", "same")};
  const std::vector<Camera> alone = {both[0]};
  const CameraIdentity first = CameraIdentity::of(both[0], both, {});
  const CameraIdentity again = CameraIdentity::of(alone[0], alone, first);
  EXPECT_FALSE(again.serial_is_unique);
  EXPECT_TRUE(CameraIdentity::of(alone[0], alone, {}).serial_is_unique);
  EXPECT_NE(found("/dev/video0", {both[1]}, again), "/dev/video2");
}

TEST(FindCamera, AnyCameraOfTheCardWillDoWhereThatIsItsName) {
  const CameraIdentity known = CameraIdentity::of(camera("/dev/video0", "usb-1", ""), {});
  const std::vector<Camera> after = {camera("/dev/video4", "usb-9", "")};
  EXPECT_EQ(found("card=C920", after, known), "/dev/video4");
}

TEST(CameraArrivals, NothingComesByItself) {
  CameraArrivals arrivals;
  EXPECT_FALSE(arrivals.any());
}

}  // namespace
}  // namespace waymark::capture::v4l2
