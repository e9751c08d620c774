"""A station's end of DTLS with a pre-shared key, by the system's libssl: what Python's own ssl module does not have."""
import ctypes
import re
import socket
import struct

try:
    SSL, CRYPTO = ctypes.CDLL("libssl.so.3"), ctypes.CDLL("libcrypto.so.3")
except OSError:
    SSL = None

PSK_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(ctypes.c_char), ctypes.c_uint,
                                ctypes.POINTER(ctypes.c_ubyte), ctypes.c_uint)
BIO_CTRL_DGRAM_SET_CONNECTED, DTLS_CTRL_HANDLE_TIMEOUT = 32, 74

if SSL is not None:
    for library, name, result, arguments in (
            (SSL, "DTLS_client_method", ctypes.c_void_p, []), (SSL, "SSL_CTX_new", ctypes.c_void_p, [ctypes.c_void_p]),
            (SSL, "SSL_CTX_set_cipher_list", ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p]),
            (SSL, "SSL_CTX_set_psk_client_callback", None, [ctypes.c_void_p, PSK_CALLBACK]),
            (SSL, "SSL_new", ctypes.c_void_p, [ctypes.c_void_p]), (SSL, "SSL_free", None, [ctypes.c_void_p]),
            (SSL, "SSL_CTX_free", None, [ctypes.c_void_p]),
            (SSL, "SSL_set_bio", None, [ctypes.c_void_p] * 3), (SSL, "SSL_connect", ctypes.c_int, [ctypes.c_void_p]),
            (SSL, "SSL_ctrl", ctypes.c_long, [ctypes.c_void_p, ctypes.c_int, ctypes.c_long, ctypes.c_void_p]),
            (SSL, "SSL_write", ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int]),
            (SSL, "SSL_read", ctypes.c_int, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int]),
            (CRYPTO, "BIO_new_dgram", ctypes.c_void_p, [ctypes.c_int, ctypes.c_int]),
            (CRYPTO, "BIO_ADDR_new", ctypes.c_void_p, []), (CRYPTO, "BIO_ADDR_free", None, [ctypes.c_void_p]),
            (CRYPTO, "BIO_ADDR_rawmake", ctypes.c_int,
             [ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_ushort]),
            (CRYPTO, "BIO_ctrl", ctypes.c_long, [ctypes.c_void_p, ctypes.c_int, ctypes.c_long, ctypes.c_void_p])):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments


class Channel:
    """One association over `sock`, a UDP socket of its own that is connected to the server; send() and recv() as that."""

    def __init__(self, test, sock, key_file):
        text = key_file.read_text()
        identity, psk = (re.search(rf'^{name} = "(.*)"$', text, re.M).group(1) for name in ("identity", "psk"))

        def show(_ssl, _hint, name, name_room, key, key_room):
            assert len(identity) < name_room and len(psk) // 2 <= key_room
            ctypes.memmove(name, identity.encode() + b"\0", len(identity) + 1)
            ctypes.memmove(key, bytes.fromhex(psk), len(psk) // 2)
            return len(psk) // 2

        self.sock, self.show = sock, PSK_CALLBACK(show)  # kept: OpenSSL holds only its address
        sock.settimeout(None)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 10, 0))
        context = SSL.SSL_CTX_new(SSL.DTLS_client_method())
        test.addCleanup(SSL.SSL_CTX_free, context)
        SSL.SSL_CTX_set_cipher_list(context, b"PSK-AES128-GCM-SHA256")
        SSL.SSL_CTX_set_psk_client_callback(context, self.show)
        self.ssl = SSL.SSL_new(context)
        test.addCleanup(SSL.SSL_free, self.ssl)
        bio = CRYPTO.BIO_new_dgram(sock.fileno(), 0)
        host, port = sock.getpeername()
        peer = CRYPTO.BIO_ADDR_new()
        CRYPTO.BIO_ADDR_rawmake(peer, sock.family, bytes(map(int, host.split("."))), 4, (port & 255) << 8 | port >> 8)
        CRYPTO.BIO_ctrl(bio, BIO_CTRL_DGRAM_SET_CONNECTED, 0, peer)
        CRYPTO.BIO_ADDR_free(peer)
        SSL.SSL_set_bio(self.ssl, bio, bio)
        # A busy server may let a step fall (PROTOCOL.md, section 10): it is repeated after a second, then two, as OpenSSL does.
        for _ in range(6):
            if SSL.SSL_connect(self.ssl) == 1:
                return
            SSL.SSL_ctrl(self.ssl, DTLS_CTRL_HANDLE_TIMEOUT, 0, None)
        raise AssertionError("no handshake")

    def send(self, datagram):
        assert SSL.SSL_write(self.ssl, datagram, len(datagram)) == len(datagram)

    def recv(self):
        """The next datagram, waited for."""
        buffer = ctypes.create_string_buffer(2048)
        size = SSL.SSL_read(self.ssl, buffer, len(buffer))
        assert size > 0, "no answer"
        return buffer.raw[:size]
