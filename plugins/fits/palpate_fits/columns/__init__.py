"""Functions over columns of samples: values, or sums of products, as fast code."""
