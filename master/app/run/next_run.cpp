#include "telenano/master/app/run/next_run.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "telenano/master/app/recordings/free_recording.h"

namespace telenano::app {
namespace {

std::vector<std::string> words_of_this_run() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  const std::string all{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  std::vector<std::string> words;
  for (std::size_t at = 0; at < all.size(); at += words.back().size() + 1)
    words.emplace_back(all.c_str() + at);
  return words;
}

/// In place of the one that was chosen before.
void choose_scene(std::vector<std::string>& words, const std::string& server_scene) {
  const std::string flag = "--server-scene";
  for (std::size_t i = 0; i < words.size();) {
    const bool apart = words[i] == flag && i + 1 < words.size();
    if (!apart && !words[i].starts_with(flag + "=")) {
      ++i;
      continue;
    }
    words.erase(words.begin() + static_cast<std::ptrdiff_t>(i),
                words.begin() + static_cast<std::ptrdiff_t>(i + (apart ? 2 : 1)));
  }
  words.insert(words.end(), {flag, server_scene});
}

void become(std::vector<std::string> words, std::string& why) {
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  ::closefrom(STDERR_FILENO + 1);
  ::execv("/proc/self/exe", pointers.data());
  why = std::string("cannot begin again: ") + std::strerror(errno);
}

}  // namespace

std::vector<std::string> words_of_next_run(std::vector<std::string> words, const std::string& server_scene) {
  if (!server_scene.empty()) choose_scene(words, server_scene);
  const std::string flag = "--record";
  if (std::find(words.begin(), words.end(), "--overwrite") != words.end()) return words;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] == flag && i + 1 < words.size()) {
      words[i + 1] = free_recording(words[i + 1]);
    } else if (words[i].starts_with(flag + "=")) {
      words[i] = flag + "=" + free_recording(words[i].substr(flag.size() + 1));
    }
  }
  return words;
}

NextRun::NextRun() : words_(words_of_this_run()) {
  thread_ = std::jthread([this] {
    wish_.wait(Wish::kNone);
    if (wish_ != Wish::kBegin) return;
    become(words_of_next_run(words_, server_scene_), why_);
    failed_ = true;
    failed_.notify_all();
  });
}

NextRun::~NextRun() {
  Wish none = Wish::kNone;
  wish_.compare_exchange_strong(none, Wish::kEnd);
  wish_.notify_all();
}

std::string NextRun::begin() {
  wish_ = Wish::kBegin;
  wish_.notify_all();
  failed_.wait(false);
  return why_;
}

}  // namespace telenano::app
