// An SDK that is too old: it can be loaded, but lacks nearly everything.
extern "C" __attribute__((visibility("default"))) int dhdOpenID(char) {
  return -1;
}
