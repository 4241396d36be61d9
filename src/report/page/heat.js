// W as a picture: a row for each source point, dark for no weight.

function makeHeat(canvas, matrix, values = matrix.weights) {
  const { side } = matrix;
  const weights = bytesOf(values);
  const byLooks = shortsOf(matrix.by_looks);
  canvas.width = canvas.height = side;
  const pen = canvas.getContext("2d");
  return function orderedBy(kind) {
    const image = pen.createImageData(side, side);
    const at = (k) => (kind === "looks" ? byLooks[k] : k);
    for (let row = 0; row < side; row++) {
      for (let column = 0; column < side; column++) {
        const colour = rampAt(weights[at(row) * side + at(column)] / 255);
        image.data.set([...colour, 255], 4 * (row * side + column));
      }
    }
    pen.putImageData(image, 0, 0);
  };
}
