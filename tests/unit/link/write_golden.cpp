// Writes those of proto/golden/*.bin that are not there yet. A file that is there is what other implementations were tested with:
// within a version of the protocol it does not change. For a new version, give it an empty folder.
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>

#include "golden_messages.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_golden FOLDER\n");
    return 2;
  }
  const auto datagrams = telenano::link::GoldenMessages{}.encoded();
  int status = 0;
  for (std::size_t i = 0; i < datagrams.size(); ++i) {
    const std::string path = std::string(argv[1]) + "/" + telenano::link::kGoldenNames[i] + ".bin";
    const std::string made(datagrams[i].begin(), datagrams[i].end());
    if (std::ifstream old(path, std::ios::binary); old) {
      const std::string there{std::istreambuf_iterator<char>(old), std::istreambuf_iterator<char>()};
      if (there == made) continue;
      std::fprintf(stderr, "%s: has other bytes than values.txt says, and is left as it is\n", path.c_str());
      status = 1;
      continue;
    }
    std::ofstream file(path, std::ios::binary);
    file.write(made.data(), static_cast<std::streamsize>(made.size()));
    file.close();
    if (!file) {
      std::fprintf(stderr, "cannot write %s\n", path.c_str());
      return 1;
    }
    std::printf("%s\n", path.c_str());
  }
  return status;
}
