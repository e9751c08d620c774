#include "telenano/common/security/resumption_cache.h"

#include <strings.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <new>

namespace telenano::security {

ResumptionCache::ResumptionCache(std::size_t capacity)
    : entries_(kWays * std::bit_ceil(std::max<std::size_t>((capacity + kWays - 1) / kWays, 1))) {}

ResumptionCache::~ResumptionCache() {
  forget_all();
}

void ResumptionCache::wipe(Entry& entry) noexcept {
  if (!entry.bytes.empty()) ::explicit_bzero(entry.bytes.data(), entry.bytes.size());
  entry = {};
}

// The servers draw ids at random, so that any bits of them spread.
std::span<ResumptionCache::Entry> ResumptionCache::places_of(const Id& id) noexcept {
  std::uint64_t bits = 0;
  std::memcpy(&bits, id.data(), sizeof bits);
  const std::size_t sets = entries_.size() / kWays;
  return {entries_.data() + kWays * (bits & (sets - 1)), kWays};
}

ResumptionCache::Entry* ResumptionCache::find(const Id& id) noexcept {
  for (Entry& entry : places_of(id)) {
    if (entry.number != 0 && entry.id == id) return &entry;
  }
  return nullptr;
}

void ResumptionCache::keep(const Id& id, const List& list, std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.empty() || bytes.size() > kMaxBytes) return;
  const std::lock_guard lock(mutex_);
  Entry* place = find(id);
  if (place == nullptr) {
    const std::span<Entry> places = places_of(id);
    place = &*std::min_element(places.begin(), places.end(),
                               [](const Entry& a, const Entry& b) { return a.number < b.number; });
  }
  wipe(*place);
  try {
    place->bytes.assign(bytes.begin(), bytes.end());
  } catch (const std::bad_alloc&) {
    return;  // the place stays empty
  }
  place->id = id;
  place->list = list;
  place->number = ++kept_;
}

std::size_t ResumptionCache::look_up(const Id& id, std::span<std::uint8_t> out) noexcept {
  const std::lock_guard lock(mutex_);
  const Entry* const entry = find(id);
  if (entry == nullptr || entry->bytes.size() > out.size()) return 0;
  std::copy(entry->bytes.begin(), entry->bytes.end(), out.begin());
  return entry->bytes.size();
}

void ResumptionCache::forget(const Id& id) noexcept {
  const std::lock_guard lock(mutex_);
  if (Entry* const entry = find(id)) wipe(*entry);
}

void ResumptionCache::forget_others(const List& list) noexcept {
  const std::lock_guard lock(mutex_);
  for (Entry& entry : entries_) {
    if (entry.number != 0 && entry.list != list) wipe(entry);
  }
}

void ResumptionCache::forget_all() noexcept {
  const std::lock_guard lock(mutex_);
  for (Entry& entry : entries_) wipe(entry);
}

}  // namespace telenano::security
