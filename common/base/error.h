#pragma once

#include <stdexcept>
#include <string>

namespace telenano {

/// A mistake that a person can mend: a wrong flag, file, key, value or peer. what() is one line that names
/// what is wrong, where, and what is expected. Thrown at start-up only, never in a loop; programs print it
/// and exit with 2 (wrong usage or configuration).
class UserError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Something that failed while running (a full disk, a lost server): programs print it and exit with 1.
class RunError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace telenano
