"""The laws of the chain, floats in and floats out; they know no solver."""
