#pragma once

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace revisit {

/// Makes items first..n-1 in several threads; the calling thread takes them in order. A worker
/// starts the next item as soon as a slot is free, without waiting for a batch.
///
///   in_order(0, n, threads, slots, [&](int64_t i, int thread, Slot& slot) { slot = work(i); },
///            [&](int64_t i, Slot& slot) { write(slot); });
///
/// An exception of `make` is rethrown in the order of items, one of `take` at once; both after the
/// workers have finished their current items.
template <class Slot, class Make, class Take>
void in_order(int64_t first, int64_t n, int threads, std::vector<Slot>& slots, const Make& make,
              const Take& take) {
  enum class State { kFree, kMaking, kMade };
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<State> states(slots.size(), State::kFree);
  std::vector<std::exception_ptr> errors(slots.size());
  int64_t next_item = first;
  bool stopped = false;
  const auto slot_of = [&](int64_t item) { return static_cast<size_t>(item) % slots.size(); };

  const auto work = [&](int thread) {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [&] {
        return stopped || next_item == n || states[slot_of(next_item)] == State::kFree;
      });
      if (stopped || next_item == n) return;
      const int64_t item = next_item++;
      const size_t s = slot_of(item);
      states[s] = State::kMaking;
      lock.unlock();
      try {
        make(item, thread, slots[s]);
      } catch (...) {
        errors[s] = std::current_exception();
      }
      lock.lock();
      states[s] = State::kMade;
      changed.notify_all();
    }
  };
  const auto stop = [&] {
    {
      const std::scoped_lock lock(mutex);
      stopped = true;
    }
    changed.notify_all();
  };

  std::vector<std::jthread> workers;
  try {
    for (int t = 0; t < threads; ++t) workers.emplace_back(work, t);
    for (int64_t item = first; item < n; ++item) {
      const size_t s = slot_of(item);
      {
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return states[s] == State::kMade; });
      }
      if (errors[s]) std::rethrow_exception(errors[s]);
      take(item, slots[s]);
      {
        const std::scoped_lock lock(mutex);
        states[s] = State::kFree;
      }
      changed.notify_all();
    }
  } catch (...) {
    stop();  // the jthreads then join
    throw;
  }
}

}  // namespace revisit
