#pragma once

#include <string>
#include <string_view>

namespace telenano::security {

/// An identity is a key pair that its own machine has made: the private half never leaves the file, and the other
/// end knows the public half by its name, "sha256:" and 64 lower-case hexadecimal digits (SHA-256 of the
/// SubjectPublicKeyInfo, as in RFC 7469). What DTLS 1.2 carries is a certificate that the pair has signed itself;
/// nothing in it but the key counts.

/// A new pair (ECDSA, P-256) in a private file. Returns the public key's name. Throws UserError if the file exists.
std::string create_identity(const std::string& path, const std::string& what);

/// The public key's name of the pair in a file. Throws UserError, one line, for a file that others can read, or
/// that holds no such pair; never with what is in it.
std::string read_identity_name(const std::string& path, const std::string& what);

/// The 64 digits of such a name, with "sha256:" before them or without; empty for anything else.
std::string public_key_digits(std::string_view name);

}  // namespace telenano::security
