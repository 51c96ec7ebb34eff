#include "capture/v4l2/controls.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <string_view>

#include <linux/videodev2.h>

#include "base/system_reason.h"

namespace waymark::capture::v4l2 {
namespace {

constexpr double kExposureUnit_s = 100e-6;  // of V4L2_CID_EXPOSURE_ABSOLUTE

std::string optionName(std::string_view title) {
  std::string name;
  for (const char c : title) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0) {
      name += static_cast<char>(std::tolower(byte));
    } else if (!name.empty() && name.back() != '_') {
      name += '_';
    }
  }
  while (!name.empty() && name.back() == '_') name.pop_back();
  return name;
}

template <std::size_t size>
std::string_view title(const char (&field)[size]) {
  return {std::begin(field),
          static_cast<std::size_t>(std::find(field, field + size, '\0') - field)};
}

template <std::size_t size>
std::string_view title(const std::uint8_t (&field)[size]) {
  const auto* end = std::find(field, field + size, std::uint8_t{0});
  return {reinterpret_cast<const char*>(field), static_cast<std::size_t>(end - field)};
}

std::optional<Control::Kind> kindOf(std::uint32_t type) {
  switch (type) {
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_INTEGER64:
    case V4L2_CTRL_TYPE_BITMASK:
      return Control::Kind::kNumber;
    case V4L2_CTRL_TYPE_BOOLEAN:
      return Control::Kind::kSwitch;
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
      return Control::Kind::kMenu;
    default:
      return {};
  }
}

std::vector<std::pair<std::int64_t, std::string>> readMenu(const Device& device,
                                                           const v4l2_query_ext_ctrl& query) {
  std::vector<std::pair<std::int64_t, std::string>> menu;
  for (std::int64_t i = query.minimum; i <= query.maximum && menu.size() < 256; ++i) {
    v4l2_querymenu entry{};
    entry.id = query.id;
    entry.index = static_cast<std::uint32_t>(i);
    if (device.call(VIDIOC_QUERYMENU, &entry) != 0) continue;  // menus have gaps
    menu.emplace_back(i, query.type == V4L2_CTRL_TYPE_INTEGER_MENU
                             ? std::to_string(entry.value)
                             : std::string(title(entry.name)));
  }
  return menu;
}

// One control's value through the one call that takes all kinds.
struct ControlArgument {
  explicit ControlArgument(const Control& control, std::int64_t value = 0) {
    entry.id = control.id;
    const bool wide = control.min < INT32_MIN || control.max > INT32_MAX;
    if (wide) {
      entry.value64 = value;
    } else {
      entry.value = static_cast<std::int32_t>(value);
    }
    list.which = V4L2_CTRL_WHICH_CUR_VAL;
    list.count = 1;
    list.controls = &entry;
  }
  ControlArgument(const ControlArgument&) = delete;
  ControlArgument& operator=(const ControlArgument&) = delete;

  v4l2_ext_control entry{};
  v4l2_ext_controls list{};
};

std::string sameCase(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

std::optional<std::int64_t> menuValue(const Control& control, const std::string& name) {
  const auto found = std::ranges::find_if(control.menu, [&](const auto& entry) {
    return sameCase(entry.second) == sameCase(name) || optionName(entry.second) == name;
  });
  return found == control.menu.end() ? std::nullopt : std::optional(found->first);
}

std::string menuText(const Control& control) {
  std::string text;
  for (const auto& [value, name] : control.menu) {
    text += (text.empty() ? "" : ", ") + std::to_string(value) + " (" + name + ")";
  }
  return text;
}

std::string allowed(const Control& control) {
  switch (control.kind) {
    case Control::Kind::kSwitch:
      return "true or false";
    case Control::Kind::kMenu:
      return "one of " + menuText(control);
    case Control::Kind::kNumber:
      break;
  }
  std::string text =
      "a whole number from " + std::to_string(control.min) + " to " + std::to_string(control.max);
  if (control.step > 1) text += " in steps of " + std::to_string(control.step);
  return text;
}

bool isAllowed(const Control& control, std::int64_t value) {
  if (control.kind == Control::Kind::kMenu) {
    return std::ranges::any_of(control.menu,
                               [&](const auto& entry) { return entry.first == value; });
  }
  return value >= control.min && value <= control.max &&
         (value - control.min) % std::max<std::int64_t>(control.step, 1) == 0;
}

std::string valueText(const Control& control, std::int64_t value) {
  if (control.kind == Control::Kind::kSwitch) return value != 0 ? "true" : "false";
  for (const auto& [number, name] : control.menu) {
    if (number == value) return std::to_string(value) + " (" + name + ")";
  }
  return std::to_string(value);
}

// One control to be set, and what became of it.
struct Wish {
  const Control* control;
  std::int64_t value;
  std::string rejection;  // the driver's, if so
};

const Control* find(const std::vector<Control>& controls, std::uint32_t id) {
  const auto found = std::ranges::find(controls, id, &Control::id);
  return found == controls.end() ? nullptr : &*found;
}

// exposure_s as the two controls of a webcam.
void wishForExposure(const std::vector<Control>& controls, double exposure_s,
                     std::vector<Wish>* wishes, std::vector<std::string>* different) {
  const Control* const time = find(controls, V4L2_CID_EXPOSURE_ABSOLUTE);
  if (time == nullptr) {
    different->push_back(
        "exposure_s: the camera has no exposure time in seconds; set its own under controls");
    return;
  }
  if (const Control* const automatic = find(controls, V4L2_CID_EXPOSURE_AUTO)) {
    wishes->push_back({automatic, V4L2_EXPOSURE_MANUAL, {}});
  }
  const auto units = static_cast<std::int64_t>(std::llround(exposure_s / kExposureUnit_s));
  if (units < time->min || units > time->max) {
    different->push_back("exposure_s: the camera can do " +
                         std::to_string(static_cast<double>(time->min) * kExposureUnit_s) + " to " +
                         std::to_string(static_cast<double>(time->max) * kExposureUnit_s));
  }
  wishes->push_back({time, std::clamp(units, time->min, time->max), {}});
}

std::string unknownControl(const std::vector<Control>& controls, const std::string& name) {
  std::string known;
  for (const Control& control : controls) known += (known.empty() ? "" : ", ") + control.name;
  return name + ": the camera has no such control" + (known.empty() ? "" : "; it has " + known);
}

void wishForControl(const std::vector<Control>& controls, const std::string& name,
                    const ControlValue& asked, std::vector<Wish>* wishes,
                    std::vector<std::string>* different) {
  const auto control = std::ranges::find(controls, name, &Control::name);
  if (control == controls.end()) {
    different->push_back(unknownControl(controls, name));
    return;
  }
  std::string objection;
  if (const std::optional<std::int64_t> value = controlValue(*control, asked, &objection)) {
    wishes->push_back({&*control, *value, {}});
  } else {
    different->push_back(name + ": " + objection);
  }
}

void set(const Device& device, Wish* wish) {
  ControlArgument argument(*wish->control, wish->value);
  if (device.call(VIDIOC_S_EXT_CTRLS, &argument.list) != 0) wish->rejection = systemReason();
}

}  // namespace

std::vector<Control> listControls(const Device& device) {
  constexpr std::uint32_t kNext = V4L2_CTRL_FLAG_NEXT_CTRL;
  std::vector<Control> controls;
  v4l2_query_ext_ctrl query{};
  for (query.id = kNext; device.call(VIDIOC_QUERY_EXT_CTRL, &query) == 0; query.id |= kNext) {
    const std::optional<Control::Kind> kind = kindOf(query.type);
    const bool single = query.nr_of_dims == 0;
    if (!kind || !single || (query.flags & V4L2_CTRL_FLAG_DISABLED) != 0) continue;
    Control control{.id = query.id,
                    .name = optionName(title(query.name)),
                    .kind = *kind,
                    .min = query.minimum,
                    .max = query.maximum,
                    .step = static_cast<std::int64_t>(query.step),
                    .standard = query.default_value,
                    .menu = {},
                    .read_only = (query.flags & V4L2_CTRL_FLAG_READ_ONLY) != 0,
                    .inactive = (query.flags & V4L2_CTRL_FLAG_INACTIVE) != 0};
    if (*kind == Control::Kind::kMenu) control.menu = readMenu(device, query);
    controls.push_back(std::move(control));
  }
  return controls;
}

std::optional<std::int64_t> readControl(const Device& device, const Control& control) {
  ControlArgument argument(control);
  if (device.call(VIDIOC_G_EXT_CTRLS, &argument.list) != 0) return {};
  const bool wide = control.min < INT32_MIN || control.max > INT32_MAX;
  return wide ? argument.entry.value64 : argument.entry.value;
}

std::string describeControl(const Control& control, std::optional<std::int64_t> value) {
  std::string text = allowed(control) + "; default " + valueText(control, control.standard);
  if (value) text += ", is " + valueText(control, *value);
  if (control.read_only) text += ", read only";
  if (control.inactive) text += ", inactive";
  return text;
}

std::optional<std::int64_t> controlValue(const Control& control, const ControlValue& asked,
                                         std::string* objection) {
  std::optional<std::int64_t> value;
  if (const auto* number = std::get_if<std::int64_t>(&asked)) value = *number;
  if (const auto* on = std::get_if<bool>(&asked);
      on != nullptr && control.kind == Control::Kind::kSwitch) {
    value = *on ? 1 : 0;
  }
  if (const auto* name = std::get_if<std::string>(&asked)) value = menuValue(control, *name);
  if (value && isAllowed(control, *value)) return value;
  *objection = "must be " + allowed(control);
  return {};
}

std::vector<std::string> applyControls(const Device& device, const CameraOptions& options) {
  const std::vector<Control> controls = listControls(device);
  std::vector<std::string> different;
  std::vector<Wish> wishes;
  if (options.exposure_s) {
    wishForExposure(controls, *options.exposure_s, &wishes, &different);
  }
  for (const auto& [name, asked] : options.controls) {
    wishForControl(controls, name, asked, &wishes, &different);
  }
  std::ranges::stable_partition(
      wishes, [](const Wish& wish) { return wish.control->kind != Control::Kind::kNumber; });
  for (Wish& wish : wishes) set(device, &wish);

  for (const Wish& wish : wishes) {
    const Control& control = *wish.control;
    const std::optional<std::int64_t> now = readControl(device, control);
    if (now == wish.value && wish.rejection.empty()) continue;
    std::string line = control.name + ": asked for " + valueText(control, wish.value) + ", it is " +
                       (now ? valueText(control, *now) : "unknown");
    if (!wish.rejection.empty()) line += " (" + wish.rejection + ")";
    different.push_back(std::move(line));
  }
  return different;
}

std::int64_t exposureNs(const Device& device) {
  const std::vector<Control> controls = listControls(device);
  const Control* const time = find(controls, V4L2_CID_EXPOSURE_ABSOLUTE);
  if (time == nullptr) return 0;
  if (const Control* const automatic = find(controls, V4L2_CID_EXPOSURE_AUTO)) {
    const std::optional<std::int64_t> mode = readControl(device, *automatic);
    const bool fixed = mode == V4L2_EXPOSURE_MANUAL || mode == V4L2_EXPOSURE_SHUTTER_PRIORITY;
    if (!fixed) return 0;
  }
  const std::optional<std::int64_t> units = readControl(device, *time);
  return units ? std::llround(static_cast<double>(*units) * kExposureUnit_s * 1e9) : 0;
}

}  // namespace waymark::capture::v4l2
