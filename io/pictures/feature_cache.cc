#include "io/pictures/feature_cache.h"

#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "io/text/fnv.h"

namespace waymark::io {
namespace {

// Whoever changes what is written, how features are computed or what looks alike, counts up.
constexpr std::string_view kMagic = "WMFEAT02";
constexpr std::uint32_t kMostFeatures = 100'000;
constexpr std::uint32_t kMostBytes = 1'024;  // of a descriptor

// Numbers as this computer has them: the cache does not travel.
template <typename T>
void put(const T& value, std::string* out) {
  static_assert(std::is_trivially_copyable_v<T>);
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out->append(bytes, sizeof(T));
}

// Reads on from the front; false when there is not enough.
template <typename T>
bool take(std::string_view* bytes, T* value) {
  if (bytes->size() < sizeof(T)) return false;
  std::memcpy(value, bytes->data(), sizeof(T));
  bytes->remove_prefix(sizeof(T));
  return true;
}

bool takeSet(std::string_view* bytes, slam::FeatureSet* set) {
  std::uint32_t kind = 0;
  std::uint32_t descriptor_bytes = 0;
  std::uint32_t count = 0;
  std::uint32_t upright = 0;
  if (!take(bytes, &kind) || !take(bytes, &descriptor_bytes) || !take(bytes, &count) ||
      !take(bytes, &upright)) {
    return false;
  }
  if (kind > static_cast<std::uint32_t>(slam::FeatureKind::kOrb) || count > kMostFeatures ||
      upright > count || descriptor_bytes > kMostBytes || (count > 0 && descriptor_bytes == 0)) {
    return false;
  }
  set->kind = static_cast<slam::FeatureKind>(kind);
  set->descriptor_bytes = static_cast<int>(descriptor_bytes);
  set->upright = upright;
  for (std::uint32_t i = 0; i < count; ++i) {
    slam::Feature f;
    if (!take(bytes, &f.x_px) || !take(bytes, &f.y_px) || !take(bytes, &f.size_px) ||
        !take(bytes, &f.angle_rad) || !take(bytes, &f.strength)) {
      return false;
    }
    if (!std::isfinite(f.x_px + f.y_px + f.size_px + f.angle_rad)) return false;
    set->features.push_back(f);
  }
  const std::size_t descriptors = std::size_t{count} * descriptor_bytes;
  if (bytes->size() < descriptors) return false;
  set->descriptors.assign(bytes->begin(),
                          bytes->begin() + static_cast<std::ptrdiff_t>(descriptors));
  bytes->remove_prefix(descriptors);
  return true;
}

bool takeAlike(std::string_view* bytes, const FeatureCache& cache, AlikeKeys* pair) {
  return take(bytes, &pair->first) && take(bytes, &pair->second) && take(bytes, &pair->shared) &&
         take(bytes, &pair->share) && cache.features.contains(pair->first) &&
         cache.features.contains(pair->second) && pair->first != pair->second &&
         std::isfinite(pair->share);
}

}  // namespace

std::filesystem::path featureCachePath(const std::filesystem::path& markers) {
  std::filesystem::path path = markers;
  path += ".features";
  return path;
}

std::uint64_t featureKey(std::string_view image, const slam::NaturalMarkerOptions& options) {
  std::string decisive;
  put(options.max_side_px, &decisive);
  put(options.max_features, &decisive);
  put(options.max_tilted_features, &decisive);
  put(options.tilted_views, &decisive);
  put(options.tilt_factor, &decisive);
  put(options.features.kind, &decisive);
  put(options.features.sift_contrast, &decisive);
  return fnv1a(decisive, fnv1a(image));
}

FeatureCache parseFeatureCache(std::string_view bytes) {
  constexpr std::size_t kSum = sizeof(std::uint64_t);
  if (bytes.size() < kMagic.size() + kSum || bytes.substr(0, kMagic.size()) != kMagic) return {};
  std::uint64_t sum = 0;
  std::string_view tail = bytes.substr(bytes.size() - kSum);
  (void)take(&tail, &sum);
  bytes.remove_suffix(kSum);
  if (fnv1a(bytes) != sum) return {};
  bytes.remove_prefix(kMagic.size());
  FeatureCache cache;
  std::uint32_t pictures = 0;
  if (!take(&bytes, &pictures)) return {};
  for (std::uint32_t i = 0; i < pictures; ++i) {
    std::uint64_t key = 0;
    slam::FeatureSet set;
    if (!take(&bytes, &key) || !takeSet(&bytes, &set)) return {};
    cache.features[key] = std::move(set);
  }
  while (!bytes.empty()) {
    AlikeKeys pair;
    if (!takeAlike(&bytes, cache, &pair)) return {};
    cache.alike.push_back(pair);
  }
  return cache;
}

std::string formatFeatureCache(const FeatureCache& cache) {
  std::string out(kMagic);
  put(static_cast<std::uint32_t>(cache.features.size()), &out);
  for (const auto& [key, set] : cache.features) {
    put(key, &out);
    put(static_cast<std::uint32_t>(set.kind), &out);
    put(static_cast<std::uint32_t>(set.descriptor_bytes), &out);
    put(static_cast<std::uint32_t>(set.size()), &out);
    put(static_cast<std::uint32_t>(set.upright), &out);
    for (const slam::Feature& f : set.features) {
      put(f.x_px, &out);
      put(f.y_px, &out);
      put(f.size_px, &out);
      put(f.angle_rad, &out);
      put(f.strength, &out);
    }
    out.append(reinterpret_cast<const char*>(set.descriptors.data()), set.descriptors.size());
  }
  for (const AlikeKeys& pair : cache.alike) {
    put(pair.first, &out);
    put(pair.second, &out);
    put(pair.shared, &out);
    put(pair.share, &out);
  }
  put(fnv1a(out), &out);
  return out;
}

}  // namespace waymark::io
